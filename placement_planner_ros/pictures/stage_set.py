"""The stage of a motion: scene, robot and things, and a view in which little hides these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import trimesh

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.pictures.picture import (
    HAND,
    OVERSAMPLING,
    VOLUME,
    RobotShapes,
    Triangles,
    box_corners,
    hiding,
    moved,
    translucent,
)
from placement_planner_ros.pictures.rendering import Image, Mesh, Viewpoint, joined, render
from placement_planner_ros.pictures.viewpoint import best_direction
from placement_planner_ros.playback import CARRIED, Playback
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.primitives import Colour
from placement_planner_ros.scenes.scenes import Scene
from placement_planner_ros.scenes.single_mesh import ring_triangles

SIZE = (720, 514)
"""Pixels of a picture once it is averaged, without its words."""
COLOURS: tuple[Colour, ...] = (
    (0.15, 0.70, 0.25),
    (0.15, 0.45, 0.90),
    (0.65, 0.25, 0.80),
    (0.98, 0.78, 0.10),
)
"""Of the things, one after the other, and of the ways that they are carried."""
_WAY_RADIUS, _EDGE_RADIUS = 0.003, 0.0015
"""m, of the tubes that ways and the edges of V are drawn as."""
_AROUND_M = 0.1
"""What a picture holds of robot and scene around V and the ways."""
_LOOK_PERIOD = 0.02
"""Seconds from look to look at a motion that is played."""
_APART_M = 0.02
"""Between points on what may hide something."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """All at one moment.

    Attributes:
        stage: what is being done: those of `Playback`, or for people.
        time: seconds since the beginning.
        q: (nq,) of the robot.
        places: T_world_thing by name.
    """

    stage: str
    time: float
    q: Array
    places: Mapping[str, pin.SE3]


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """One thing put down.

    Attributes:
        name: for people.
        key: by which looks name the thing.
        vertices, triangles: (n, 3) and (t, 3) in its frame.
        looks: at each moment, the last at what has come of it.
    """

    name: str
    key: str
    vertices: Array
    triangles: Triangles
    looks: Sequence[Look]

    @classmethod
    def played(
        cls, name: str, vertices: Array, triangles: Triangles, robot: Robot, motion: Playback
    ) -> Leg:
        """A solution's motion."""
        count = 1 + int(np.ceil(motion.duration / _LOOK_PERIOD))
        looks = []
        for time in np.linspace(0.0, motion.duration, count).tolist():
            at = motion.at(time)
            q = robot.configuration(at.positions)
            looks.append(Look(at.stage, time, q, {name: at.T_world_object}))
        return cls(name, name, vertices, triangles, looks)

    @property
    def carried(self) -> list[Look]:
        """Those while it is in the hand."""
        return [look for look in self.looks if look.stage in CARRIED]

    @property
    def way(self) -> Array:
        """(n, 3) where the thing's origin is carried along."""
        return np.array([look.places[self.key].translation for look in self.carried])


class StageSet:
    """A scene in which things are put down, ready to be drawn at any look.

    Args:
        hand_links: links in the darker colour.
        legs: in order.
    """

    def __init__(
        self, scene: Scene, robot: Robot, hand_links: Sequence[str], legs: Sequence[Leg]
    ) -> None:
        self.legs = legs
        self._colours = {leg.key: COLOURS[k % len(COLOURS)] for k, leg in enumerate(legs)}
        self._robot = RobotShapes(robot, hand_links)
        self._parts = [Mesh(part.vertices, part.triangles, part.colour) for part in scene.parts]
        self._ways = [tube(leg.way, _WAY_RADIUS, self._colours[leg.key]) for leg in legs]
        self._edges = volume_edges(scene.volume)
        self._points = self._shown(scene)
        self._direction = self._best_direction(scene)
        self._show(SIZE)

    def sized(self, size: tuple[int, int]) -> StageSet:
        """The same from the same side, of so many pixels."""
        other = copy(self)
        other._show(size)
        return other

    def _show(self, size: tuple[int, int]) -> None:
        width, height = (OVERSAMPLING * side for side in size)
        self.view = Viewpoint.around(self._points, *self._direction, width, height)
        parts = translucent(self._parts, self._hides(self.view))
        self._glass = [part for part in parts if part.alpha < 1.0]
        solid = [part for part in parts if part.alpha == 1.0]
        self._behind = render(self.view, joined([*solid, *self._edges]))
        self._link_hides = [self._hidden_by_links(leg.looks[-1]) for leg in self.legs]

    def draw(self, leg: int, look: Look, all_ways: bool = False) -> Image:
        """The picture of that moment of a leg, with its way, or with those of all legs."""
        links = translucent(self._robot.at(look.q), self._link_hides[leg])
        ways = self._ways if all_ways else [self._ways[leg]]
        shown = [*joined(links), *ways, *self._things(look), *self._glass]
        return render(self.view, shown, self._behind)

    def _things(self, look: Look) -> list[Mesh]:
        return [
            Mesh(moved(leg.vertices, look.places[leg.key]), leg.triangles, self._colours[leg.key])
            for leg in self.legs
            if leg.key in look.places
        ]

    def _hidden_by_links(self, look: Look) -> list[bool]:
        """Which links stand before a thing at last."""
        links = self._robot.at(look.q)
        hides = [hiding(self.view, thing.vertices, links) for thing in self._things(look)]
        return np.any(hides, axis=0).tolist()

    def _shown(self, scene: Scene) -> Array:
        """(n, 3) points that the picture has to hold."""
        must = [box_corners(scene.volume.lower, scene.volume.upper)]
        must += [leg.way for leg in self.legs]
        must += [moved(leg.vertices, leg.looks[0].places[leg.key]) for leg in self.legs]
        first = self._robot.at(self.legs[0].looks[0].q)
        must += [link.vertices for link in first if link.colour == HAND]
        robot = [link for leg in self.legs for link in self._robot.at(leg.looks[-1].q)]
        return with_surroundings(np.vstack(must), [*robot, *self._parts], _AROUND_M)

    def _best_direction(self, scene: Scene) -> tuple[float, float]:
        """From where robot and scene leave most to be seen of the things where they stand and of
        their ways."""
        stand = [thing.vertices for thing in self._things(self.legs[-1].looks[-1])]
        matter = np.vstack([*stand, *(leg.way for leg in self.legs)])
        robot = joined(link for leg in self.legs for link in self._robot.at(leg.looks[-1].q))
        links = [_points_on(mesh) for mesh in robot]
        around = [complete_cloud(scene, _APART_M)] if scene.parts else []
        hiders = np.vstack([*around, *links])
        base = self._robot.at(self.legs[0].looks[0].q)[0].vertices.mean(axis=0)
        distance = 2.0 * float(np.linalg.norm(np.ptp(matter, axis=0)))
        return best_direction(_few(matter), hiders, base, distance)

    def _hides(self, view: Viewpoint) -> list[bool]:
        """Which parts of the scene stand before a thing at its place or on its way."""
        shown = [thing.vertices for thing in self._things(self.legs[-1].looks[-1])]
        shown += [leg.way for leg in self.legs]
        return np.any([hiding(view, points, self._parts) for points in shown], axis=0).tolist()


def _few(points: Array) -> Array:
    """Some sixty of the points (n, 3)."""
    return points[:: max(1, len(points) // 60)]


def _points_on(mesh: Mesh) -> Array:
    """(n, 3) points on a surface, `_APART_M` apart or so."""
    made = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    count = int(made.area / _APART_M**2) + 1
    return np.asarray(trimesh.sample.sample_surface(made, count, seed=0)[0])


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
