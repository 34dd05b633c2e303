"""The stage on which things are put down: scene, robot and things, seen from across the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.pictures.rendering import Image, Mesh, Viewpoint, joined, render
from placement_planner_ros.pictures.shapes import (
    HAND,
    PLACED,
    RobotShapes,
    Triangles,
    box_corners,
    moved,
    see_through,
    tube,
    volume_edges,
)
from placement_planner_ros.playback import Playback
from placement_planner_ros.scenes.primitives import Colour
from placement_planner_ros.scenes.scenes import Scene

SIZE = (720, 514)
"""Pixels of a picture, without its words."""
COLOURS: tuple[Colour, ...] = (
    PLACED,
    (0.15, 0.45, 0.90),
    (0.65, 0.25, 0.80),
    (0.98, 0.78, 0.10),
)
"""Of the things, one after the other, and of the ways that they are carried."""
_ASIDE, _ELEVATION = np.deg2rad([30.0, 45.0])
"""rad: azimuth of the eye from the robot's front, and its elevation."""
_WAY_RADIUS_M = 0.003
"""Of the tubes that ways are drawn as."""
_AROUND_M = 0.1
"""What a picture holds of robot and scene around V and the ways."""


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """One thing put down.

    Attributes:
        name: for people.
        vertices, triangles: (n, 3) and (t, 3) in its frame.
        motion: of the robot, and of the thing in its hand.
    """

    name: str
    vertices: Array
    triangles: Triangles
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
        # scene, ways and where things come to stand
        parts = [Mesh(part.vertices, part.triangles, part.colour) for part in scene.parts]
        ways = [leg.motion.path() for leg in legs]
        standing = [moved(leg.vertices, leg.motion.T_world_placed) for leg in legs]
        self.view = self._view_of(np.vstack([*_corners(scene), *ways, *standing]), parts)
        for points in (*ways, *standing):
            parts = see_through(self.view, points, parts)
        tubes = [tube(way, _WAY_RADIUS_M, COLOURS[k % len(COLOURS)]) for k, way in enumerate(ways)]
        # what never moves is drawn once; what is translucent, over all else
        solid = [part for part in parts if part.alpha == 1.0]
        self._glass = [part for part in parts if part.alpha < 1.0]
        self._behind = render(self.view, joined([*solid, *volume_edges(scene.volume), *tubes]))

    def draw(self, number: int, time: float) -> Image:
        """The picture of a leg so many seconds after its beginning; what came before it stands."""
        moment = self.legs[number].motion.at(time)
        # what came before stands; what comes later is not there yet
        poses = [leg.motion.T_world_placed for leg in self.legs[:number]] + [moment.T_world_object]
        things = [
            Mesh(moved(leg.vertices, T), leg.triangles, COLOURS[k % len(COLOURS)])
            for k, (leg, T) in enumerate(zip(self.legs, poses, strict=False))
        ]
        links = joined(self._robot.at(self._model.configuration(moment.positions)))
        return render(self.view, [*links, *things, *self._glass], self._behind)

    def _view_of(self, points: Array, parts: Sequence[Mesh]) -> Viewpoint:
        """A view of points (n, 3), the hand at the start, and what is around them."""
        first, last = self.legs[0].motion, self.legs[-1].motion
        # the first link is the base: seen from across, it faces the eye
        links = self._robot.at(self._model.configuration(first.at(0.0).positions))
        middle, base = 0.5 * (points.min(axis=0) + points.max(axis=0)), links[0].vertices
        front = np.arctan2(*(middle - base.mean(axis=0))[1::-1])
        held = moved(self.legs[0].vertices, first.at(0.0).T_world_object)
        hands = [link.vertices for link in links if link.colour == HAND]
        points = np.vstack([points, held, *hands])
        # of scene and robot what is around these
        low, high = points.min(axis=0) - _AROUND_M, points.max(axis=0) + _AROUND_M
        links += self._robot.at(self._model.configuration(last.at(last.duration).positions))
        around = np.vstack([mesh.vertices for mesh in (*links, *parts)])
        shown = around[((around > low) & (around < high)).all(axis=1)]
        size = 2 * np.array(SIZE)
        return Viewpoint.around(np.vstack([points, shown]), (front + _ASIDE, _ELEVATION), size)


def _corners(scene: Scene) -> list[Array]:
    return [box_corners(*box) for box in scene.volume.joined]
