"""The stage of a motion: scene, object, and a view in which little hides it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.pictures.picture import (
    OVERSAMPLING,
    PLACED,
    VOLUME,
    RobotShapes,
    Triangles,
    box_corners,
    hiding,
    moved,
    see_through,
    translucent,
)
from placement_planner_ros.pictures.rendering import Image, Mesh, Viewpoint, joined, render
from placement_planner_ros.pictures.viewpoint import best_direction, seen_share
from placement_planner_ros.playback import Playback, PlaybackMoment
from placement_planner_ros.scenes.primitives import Colour
from placement_planner_ros.scenes.scenes import Scene
from placement_planner_ros.scenes.single_mesh import ring_triangles

WIDTH, HEIGHT = 720, 540
"""Pixels of a picture once it is averaged."""
PATH: Colour = (0.95, 0.55, 0.05)
_PATH_RADIUS, _EDGE_RADIUS = 0.003, 0.0015
"""m, of the tubes that the path and the edges of V are drawn as."""
_NEAR = 0.12
"""m around V and the object's path within which the scene and the robot have to be seen."""


class StageSet:
    """A scene with a robot and an object in motion, ready to be drawn at any moment.

    Args:
        hand_links: links in the darker colour.
        body: vertices (n, 3) and triangles (t, 3) of the object in its own frame.
    """

    def __init__(
        self,
        motion: Playback,
        robot: Robot,
        hand_links: Sequence[str],
        scene: Scene,
        body: tuple[Array, Triangles],
    ) -> None:
        self.motion, self._body = motion, body
        self._robot, self._shapes = robot, RobotShapes(robot, hand_links)
        self._things = [Mesh(part.vertices, part.triangles, part.colour) for part in scene.parts]
        first, last = motion.at(0.0), motion.at(motion.duration)
        shown = self._shown(scene.volume)
        moments = [last, last, first, *(motion.at(s * motion.duration) for s in (0.4, 0.7))]
        self.view = self._best_view(shown, moments)
        placed = moved(body[0], last.T_world_object)
        self._things = see_through(self.view, placed, self._things)
        self._link_hides = hiding(self.view, placed, self._links(last))
        solid = [mesh for mesh in self._things if mesh.alpha == 1.0]
        marks = [tube(motion.path(), _PATH_RADIUS, PATH), *volume_edges(scene.volume)]
        self._behind = render(self.view, joined([*solid, *marks]))

    def draw(self, moment: PlaybackMoment) -> Image:
        """The picture of that moment."""
        links = translucent(self._links(moment), self._link_hides)
        glass = [mesh for mesh in self._things if mesh.alpha < 1.0]
        return render(self.view, [*joined(links), self._thing(moment), *glass], self._behind)

    def _links(self, moment: PlaybackMoment) -> list[Mesh]:
        return self._shapes.at(self._robot.configuration(moment.positions))

    def _thing(self, moment: PlaybackMoment) -> Mesh:
        return Mesh(moved(self._body[0], moment.T_world_object), self._body[1], PLACED)

    def _shown(self, volume: TargetVolume) -> Array:
        """(n, 3) points that the picture has to hold."""
        motion = self.motion
        first, last = motion.at(0.0), motion.at(motion.duration)
        must = [box_corners(volume.lower, volume.upper), motion.path()]
        must += [self._thing(moment).vertices for moment in (first, last)]
        meshes = [*self._things, *self._links(first), *self._links(last)]
        return with_surroundings(np.vstack(must), meshes, _NEAR)

    def _best_view(self, shown: Array, moments: Sequence[PlaybackMoment]) -> Viewpoint:
        """The one in which most of the object, over the moments, and of its way is seen."""
        path = tube(self.motion.path(), _PATH_RADIUS, PATH)
        scenes = [(joined(self._links(moment)), self._thing(moment)) for moment in moments]

        def score(view: Viewpoint) -> float:
            behind = render(view, joined(self._things))
            seen = [seen_share(view, behind, *scene) for scene in scenes]
            way = [seen_share(view, behind, links, path) for links, _ in scenes[1:3]]
            return float(np.mean(seen) + np.mean(way))

        direction = best_direction(shown, score)
        return Viewpoint.around(shown, *direction, OVERSAMPLING * WIDTH, OVERSAMPLING * HEIGHT)


def with_surroundings(points: Array, meshes: Sequence[Mesh], margin: float) -> Array:
    """Points (n, 3) and those corners of meshes that are in their box, widened by metres."""
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    others = np.vstack([mesh.vertices for mesh in meshes])
    return np.vstack([points, others[((others > low) & (others < high)).all(axis=1)]])


def tube(points: Array, radius: float, colour: Colour, sides: int = 5) -> Mesh:
    """A tube along points (n, 3), n at least 2."""
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)])
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]
    other = np.cross(along, across)
    angles = np.arange(sides) * 2.0 * np.pi / sides
    ring = (
        np.cos(angles)[None, :, None] * across[:, None]
        + np.sin(angles)[None, :, None] * other[:, None]
    )
    vertices = (points[:, None] + radius * ring).reshape(-1, 3)
    open_ended = ring_triangles(len(points), sides)[: -2 * sides]
    return Mesh(vertices, open_ended, colour)


def volume_edges(volume: TargetVolume) -> list[Mesh]:
    """The edges of V's boxes."""
    edges = []
    for box in volume.joined:
        corners = box_corners(*box)
        for i in range(8):
            for axis in range(3):
                if not i >> axis & 1:
                    edges.append(tube(corners[[i, i | 1 << axis]], _EDGE_RADIUS, VOLUME))
    return edges
