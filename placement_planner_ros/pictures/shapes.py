"""Meshes for pictures: a robot's shapes, tubes, the edges of target volumes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise, product

import numpy as np
import pinocchio as pin
import trimesh

from placement_planner_ros.core.collision.shapes import shape_triangles
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.pictures.rendering import Mesh
from placement_planner_ros.scenes.primitives import Colour

PLACED: Colour = (0.15, 0.70, 0.25)
LINK: Colour = (0.88, 0.88, 0.90)
HAND: Colour = (0.35, 0.36, 0.42)
VOLUME: Colour = (0.85, 0.15, 0.55)
_TUBE_RADIUS_M = 0.002
"""Of what lines are drawn as."""


def moved(points: Array, T: pin.SE3) -> Array:
    """Points (..., 3) at T."""
    return np.asarray(points @ T.rotation.T + T.translation)


def box_corners(box: Array) -> Array:
    """(8, 3) of a box (2, 3)."""
    return np.array(list(product(*box.T)))


class RobotShapes:
    """The collision shapes of a robot, made once for many configurations.

    Args:
        hand_links: links in the darker colour, such as an arm's touch links.
    """

    def __init__(self, robot: Robot, hand_links: Sequence[str] = ()) -> None:
        self._robot = robot
        self._shapes = [
            (corners, HAND if link in hand_links else LINK)
            for corners, link in zip(shape_triangles(robot), robot.geometry_links, strict=True)
        ]

    def at(self, q: Array) -> list[Mesh]:
        """Each shape at q (nq,), in the order of `Robot.geometry_links`."""
        poses = self._robot.geometry_poses(q)
        shapes = zip(self._shapes, poses, strict=True)
        return [Mesh(moved(corners, T), colour) for (corners, colour), T in shapes]


def tube(points: Array, colour: Colour) -> Mesh:
    """A tube along points (n, 3), n at least 2; m."""
    parts = [
        trimesh.creation.cylinder(_TUBE_RADIUS_M, segment=np.array(ends), sections=6)
        for ends in pairwise(points)
        if np.linalg.norm(ends[1] - ends[0]) > 1e-6
    ]
    return Mesh(np.vstack([part.triangles for part in parts]), colour)


def volume_edges(volume: TargetVolume) -> list[Mesh]:
    """The edges of V's boxes."""
    return [
        tube(np.array(ends), VOLUME)
        for box in volume.boxes
        # corners that differ in one coordinate are the ends of an edge
        for ends in combinations(box_corners(box), 2)
        if np.not_equal(*ends).sum() == 1
    ]
