"""The stage on which things are put down: scene, robot and things, seen from across the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.pictures.rendering import Image, Mesh, camera_around, render
from placement_planner_ros.pictures.shapes import (
    HAND,
    PLACED,
    RobotShapes,
    box_corners,
    moved,
    tube,
    volume_edges,
)
from placement_planner_ros.playback import Playback
from placement_planner_ros.scenes.clouds import DepthCamera
from placement_planner_ros.scenes.primitives import Colour, ConvexPrimitive
from placement_planner_ros.scenes.scenes import Scene

SIZE = (720, 514)
"""Pixels of a picture, without its words."""
COLOURS: tuple[Colour, ...] = (PLACED, (0.15, 0.45, 0.90), (0.65, 0.25, 0.80), (0.98, 0.78, 0.10))
"""Of the things, one after the other, and of the ways that they are carried."""
_ASIDE, _ELEVATION = np.deg2rad([30.0, 45.0])
"""rad: azimuth of the eye from the robot's front, and its elevation."""


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """One thing put down.

    Attributes:
        name: for people.
        corners: (t, 3, 3) of its triangles, in its frame.
        motion: of the robot, and of the thing in its hand.
    """

    name: str
    corners: Array
    motion: Playback


class Stage:
    """A scene in which things are put down, ready to be drawn at any moment.

    Args:
        hand_links: links in the darker colour.
        legs: in order.
    """

    def __init__(
        self, scene: Scene, robot: Robot, hand_links: Sequence[str], legs: Sequence[Leg]
    ) -> None:
        self.legs, self._model = legs, robot
        self._robot = RobotShapes(robot, hand_links)
        # V, ways and where things come to stand shall be seen
        ways = [leg.motion.path() for leg in legs]
        standing = [moved(leg.corners, leg.motion.T_world_placed).reshape(-1, 3) for leg in legs]
        corners = [box_corners(box) for box in scene.volume.boxes]
        self.view = self._view_of(np.vstack([*corners, *ways, *standing]))
        eye = self.view.T_world_camera.translation
        # what never moves is drawn once
        parts = [
            Mesh(
                part.vertices[part.triangles],
                part.colour,
                any(_hides(part, eye, points) for points in (*ways, *standing)),
            )
            for part in scene.parts
        ]
        tubes = [tube(way, COLOURS[k % len(COLOURS)]) for k, way in enumerate(ways)]
        self._behind = render(self.view, [*parts, *volume_edges(scene.volume), *tubes])

    def draw(self, number: int, time: float) -> Image:
        """The picture of a leg so many seconds after its beginning; what came before it stands."""
        moment = self.legs[number].motion.at(time)
        # what came before stands; what comes later is not there yet
        poses = [leg.motion.T_world_placed for leg in self.legs[:number]] + [moment.T_world_object]
        things = [
            Mesh(moved(leg.corners, T), COLOURS[k % len(COLOURS)])
            for k, (leg, T) in enumerate(zip(self.legs, poses, strict=False))
        ]
        links = self._robot.at(self._model.configuration(moment.positions))
        return render(self.view, [*links, *things], self._behind)

    def _view_of(self, points: Array) -> DepthCamera:
        """A view of points (n, 3) and of the hands with what they hold at the start."""
        first = self.legs[0].motion.at(0.0)
        links = self._robot.at(self._model.configuration(first.positions))
        # the first link is the base: seen from across, it faces the eye
        middle, base = 0.5 * (points.min(axis=0) + points.max(axis=0)), links[0].corners
        front = np.arctan2(*(middle - base.mean(axis=(0, 1)))[1::-1])
        seen = [moved(self.legs[0].corners, first.T_world_object)]
        seen += [link.corners for link in links if link.colour == HAND]
        points = np.vstack([points, *(corners.reshape(-1, 3) for corners in seen)])
        size = 2 * SIZE[0], 2 * SIZE[1]
        return camera_around(points, (front + _ASIDE, _ELEVATION), size)


def _hides(solid: ConvexPrimitive, eye: Array, points: Array) -> bool:
    """Whether a solid stands before a good part of the points (n, 3)."""
    # some lines of sight, each from near the eye to just before its target
    targets = points[:: max(1, len(points) // 40)]
    along = eye + np.linspace(0.3, 0.98, 120)[:, None, None] * (targets - eye)
    depths = solid.depth(along.reshape(-1, 3)).reshape(along.shape[:2])
    return bool((depths > 1e-3).any(axis=0).mean() > 0.1)
