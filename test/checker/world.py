"""Robot, object and environment, and what collides."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from .insides import DEEP, in_bounds, inside
from .margin import too_near
from .pieces import Piece
from .poses import Poses
from .robot import RobotModel
from .shapes import convex
from .stance import standing_along
from .task import WORLD, Array, Solution, Task, Tolerances, world_vertices

_STILL = 1e-9
"""m, that no pair need come for another look."""
_CONTACTS = 1000
"""Contacts of a mesh that are looked at for its depth."""


@dataclass(frozen=True)
class World:
    """Robot, held object and environment as one pinocchio geometry model."""

    robot: RobotModel
    geometry: pin.GeometryModel
    links: list[str] = field(default_factory=list)
    moving: list[int] = field(default_factory=list)
    """Geometries that the arm moves."""
    pieces: Mapping[int, Sequence[tuple[Array, bool]]] = field(default_factory=dict)
    """`RobotModel.pieces`, and those of the object's pieces that are not convex."""
    measured: Array | None = None
    support: npt.NDArray[np.bool_] | None = None
    """(n,) which of the measured boxes are."""

    @classmethod
    def build(
        cls,
        robot: RobotModel,
        task: Task,
        components: Sequence[Piece],
        solution: Solution,
        contact: float,
        placed: Sequence[str] | None = None,
    ) -> World:
        """With the object in the hand, or at the published pose with `placed` free to touch it.

        Args:
            contact: what was measured with its top so close to the contact plane is support.
        """
        geometry = pin.GeometryModel(robot.geometry)
        geometry.removeAllCollisionPairs()
        links = [str(robot.model.frames[g.parentFrame].name) for g in geometry.geometryObjects]
        tip = robot.model.frames[robot.model.getFrameId(solution.tip_frame)]
        joint, T_joint_object = tip.parentJoint, tip.placement * pin.SE3(solution.T_tip_object)
        touching_links = set(solution.touch_links)
        if placed is not None:
            joint, T_joint_object = 0, pin.SE3(np.asarray(solution.placement_pose))
            touching_links = set(placed)
        pieces = dict(robot.pieces)
        for i, piece in enumerate(components):
            if not piece.solid:
                pieces[len(links)] = [(piece.corners, piece.closed)]
            geometry.addGeometryObject(
                pin.GeometryObject(f"object/{i}", joint, T_joint_object, piece.shape)
            )
            links.append("object")
        for i, solid in enumerate(task.solids):
            geometry.addGeometryObject(
                pin.GeometryObject(
                    f"{WORLD}/{i}/{solid.name}",
                    0,
                    pin.SE3.Identity(),
                    convex(np.asarray(solid.vertices)),
                )
            )
            links.append(WORLD)
        for i in range(len(links)):
            for j in range(i):
                pair = frozenset({links[i], links[j]})
                joint_i, joint_j = (geometry.geometryObjects[k].parentJoint for k in (i, j))
                # The base stands on what it stands on; parts of one rigid body stay as they are.
                fixed = joint_i == joint_j and (joint_i == 0 or "object" not in pair)
                touching = "object" in pair and bool(pair & touching_links)
                if len(pair) == 2 and not (fixed or touching or pair in robot.disabled):
                    geometry.addCollisionPair(pin.CollisionPair(j, i))
        for thing in geometry.geometryObjects:
            thing.geometry.computeLocalAABB()
        ids = {robot.model.getJointId(joint) for joint in solution.trajectory.joints}
        moving = [
            i
            for i, thing in enumerate(geometry.geometryObjects)
            if ids & set(robot.model.supports[thing.parentJoint].tolist())
        ]
        measured = support = None
        if task.measured is not None:
            measured = np.asarray(task.measured)
            pose = np.asarray(solution.placement_pose)
            normal = standing_along(task, pose, Tolerances(contact=contact))
            lowest = (world_vertices(task, pose) @ normal).min() / normal[2]
            # the plane that it stands on is between these heights within a box
            rises = lowest / 2 - measured[:, :, :2] * (normal[:2] / normal[2])
            low, high = rises.min(axis=0).sum(axis=1), rises.max(axis=0).sum(axis=1)
            top = measured[1, :, 2]
            support = (top >= low - contact - 1e-4) & (top <= high + contact + 1e-4)
        if len(task.keep_out):
            boxes = np.asarray(task.keep_out).transpose(1, 0, 2)
            known = np.zeros((2, 0, 3)) if measured is None else measured
            carries = np.zeros(0, np.bool_) if support is None else support
            measured = np.concatenate([known, boxes], axis=1)
            support = np.concatenate([carries, np.zeros(boxes.shape[1], np.bool_)])
        return cls(robot, geometry, links, moving, pieces, measured, support)

    def object_gaps(self, states: Array, only: Sequence[str] | None = None) -> dict[str, Array]:
        """Link -> its signed distance from the object at each of the states (k, nq)."""
        poses = Poses(self.robot.model, self.geometry, states)
        gaps: dict[str, Array] = {}
        for i, j in self.pairs:
            names = {self.links[i], self.links[j]} - {"object"}
            if len(names) == 2 or (only is not None and not names & set(only)):
                continue
            gap = gaps.setdefault(names.pop(), np.full(len(states), np.inf))
            for row in range(len(states)):
                gap[row] = min(gap[row], self._gap(poses, i, j, row))
        return gaps

    def sweep(
        self,
        states: Array,
        times: Array,
        approach_start: float,
        support: set[str],
        tolerances: Tolerances,
    ) -> list[str]:
        """Collisions at the states, one sentence per pair of links and solids."""
        poses = Poses(self.robot.model, self.geometry, states)
        down = int(np.searchsorted(times, approach_start - 1e-9))
        allowed = np.full(len(states), tolerances.penetration)
        on_support = allowed + tolerances.contact * (np.arange(len(states)) >= down)
        found: dict[tuple[str, str], tuple[int, float]] = {}
        for i, j in self._neighbours(poses):
            names = self._name(i), self._name(j)
            stands = self.links[i] == "object" and self.links[j] == WORLD and names[1] in support
            met = self._meeting(poses, i, j, on_support if stands else allowed)
            if met is not None:
                found[names] = min(found.get(names, met), met)
        collisions = [
            f"collision: {one} with {other} at {times[row]:.3f} s, {-1000 * gap:.2f} mm deep"
            for (one, other), (row, gap) in found.items()
        ]
        return [*collisions, *too_near(self, poses, times, approach_start, tolerances)]

    def _neighbours(self, poses: Poses) -> list[tuple[int, int]]:
        """Pairs that may meet: the boxes are near in which each moves."""
        first, second = np.array(self.pairs, dtype=int).reshape(-1, 2).T
        low, high = poses.middles.min(axis=0), poses.middles.max(axis=0)
        apart = np.maximum(low[first] - high[second], low[second] - high[first])
        distance = np.linalg.norm(np.maximum(apart, 0.0), axis=1)
        near = np.flatnonzero(distance <= poses.radii[first] + poses.radii[second])
        return [self.pairs[k] for k in near]

    @functools.cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Of geometries that must not meet."""
        return [(pair.first, pair.second) for pair in self.geometry.collisionPairs]

    def _meeting(self, poses: Poses, i: int, j: int, allowed: Array) -> tuple[int, float] | None:
        """The first state at which two geometries are deeper in each other than allowed (k,).

        Only states are looked at where the balls around both meet, and after each as many are left
        out as neither can come so far in, seen from the other.
        """
        between = poses.middles[:, i] - poses.middles[:, j]
        reach = poses.radii[i] + poses.radii[j]
        meeting = np.flatnonzero(np.einsum("ki,ki->k", between, between) <= reach * reach)
        if len(meeting) == 0:
            return None
        travel = poses.travel_apart(i, j)
        row = int(meeting[0])
        while True:
            gap = self._gap(poses, i, j, row)
            if gap < -allowed[row]:
                return row, gap
            free = gap + allowed[row]
            if gap <= 0.0 and (i in self.pieces or j in self.pieces):
                free = 0.0  # the depth of triangles may grow quicker than they move
            beyond = int(np.searchsorted(travel, travel[row] + max(free, _STILL), side="right"))
            left = meeting[np.searchsorted(meeting, max(beyond, row + 1)) :]
            if len(left) == 0:
                return None
            row = int(left[0])

    def _gap(self, poses: Poses, i: int, j: int, row: int) -> float:
        """Signed distance of a pair: of meshes that are not convex about as deep as triangles are.

        What lies wholly inside of a closed component of a mesh is deep.
        """
        things = [self.geometry.geometryObjects[k].geometry for k in (i, j)]
        placed = things[0], poses.at(i, row), things[1], poses.at(j, row)
        is_mesh = i in self.pieces or j in self.pieces
        request = coal.DistanceRequest()
        request.enable_signed_distance = not is_mesh
        gap = float(coal.distance(*placed, request, coal.DistanceResult()))
        if not is_mesh:
            return gap
        if gap <= 0.0:
            contacts, result = coal.CollisionRequest(), coal.CollisionResult()
            contacts.num_max_contacts = _CONTACTS
            coal.collide(*placed, contacts, result)
            depths = [result.getContact(k).penetration_depth for k in range(result.numContacts())]
            return -float(np.abs(depths).max(initial=0.0))
        if self._holds(poses, i, j, row) or self._holds(poses, j, i, row):
            return -DEEP
        return gap

    def _holds(self, poses: Poses, outer: int, inner: int, row: int) -> bool:
        """Whether a solid of triangles has inside what meets none of them."""
        solids = [corners for corners, closed in self.pieces.get(outer, []) if closed]
        if not solids:
            return False
        things = [self.geometry.geometryObjects[k].geometry for k in (outer, inner)]
        T, T_inner = poses.of(outer)[row], poses.of(inner)[row]
        points = (
            [np.array(things[1].aabb_center)]
            if inner not in self.pieces
            else [corners[0, 0] for corners, _ in self.pieces[inner]]
        )
        points = [
            (T_inner[:3, :3] @ point + T_inner[:3, 3] - T[:3, 3]) @ T[:3, :3] for point in points
        ]
        points = [point for point in points if in_bounds(things[0], point)]
        return any(inside(corners, point) for corners in solids for point in points)

    def _name(self, index: int) -> str:
        if self.links[index] == WORLD:
            return str(self.geometry.geometryObjects[index].name.split("/", 2)[2])
        return self.links[index]
