"""Robot, object and environment, and what collides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from .insides import DEEP, in_bounds, inside
from .margin import too_near
from .pieces import Piece
from .robot import RobotModel
from .shapes import convex
from .task import WORLD, Array, Solution, Task, Tolerances, world_vertices

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
                fixed = all(
                    geometry.geometryObjects[k].parentJoint == 0 for k in (i, j)
                )  # the base stands on what it stands on
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
            lowest = world_vertices(task, np.asarray(solution.placement_pose))[:, 2].min()
            support = np.abs(measured[1, :, 2] - lowest) <= contact + 1e-4
        return cls(robot, geometry, links, moving, pieces, measured, support)

    def object_gaps(self, states: Array, only: Sequence[str] | None = None) -> dict[str, Array]:
        """Link -> its signed distance from the object at each of the states (k, nq)."""
        model, geometry = self.robot.model, self.geometry
        data, shapes = model.createData(), geometry.createData()
        for request in shapes.distanceRequests:
            request.enable_signed_distance = True
        gaps: dict[str, Array] = {}
        for row, state in enumerate(states):
            pin.updateGeometryPlacements(model, data, geometry, shapes, state)
            for k, pair in enumerate(geometry.collisionPairs):
                names = {self.links[pair.first], self.links[pair.second]} - {"object"}
                if len(names) == 2 or (only is not None and not names & set(only)):
                    continue
                gap = gaps.setdefault(names.pop(), np.full(len(states), np.inf))
                gap[row] = min(gap[row], self._gap(shapes, k))
        return gaps

    def _gap(self, shapes: pin.GeometryData, k: int) -> float:
        """Signed distance of a pair: of meshes that are not convex about as deep as triangles are.

        What lies wholly inside of a closed component of a mesh is deep.
        """
        pair = self.geometry.collisionPairs[k]
        pieces = self.pieces
        if not (pair.first in pieces or pair.second in pieces):
            return float(pin.computeDistance(self.geometry, shapes, k).min_distance)
        things = [self.geometry.geometryObjects[i].geometry for i in (pair.first, pair.second)]
        T = [shapes.oMg[i] for i in (pair.first, pair.second)]
        places = [coal.Transform3s(each.rotation, each.translation) for each in T]
        placed = things[0], places[0], things[1], places[1]
        gap = coal.distance(*placed, coal.DistanceRequest(), coal.DistanceResult())
        if gap <= 0.0:
            request, result = coal.CollisionRequest(), coal.CollisionResult()
            request.num_max_contacts = _CONTACTS
            coal.collide(*placed, request, result)
            depths = [result.getContact(i).penetration_depth for i in range(result.numContacts())]
            return -float(np.abs(depths).max(initial=0.0))
        for inner, outer in ((0, 1), (1, 0)):
            other = pieces.get((pair.first, pair.second)[inner])
            points = (
                [np.array(things[inner].aabb_center)]
                if other is None
                else [corners[0, 0] for corners, _ in other]
            )
            solids = pieces.get((pair.first, pair.second)[outer], [])
            points = [T[outer].actInv(T[inner].act(point)) for point in points]
            points = [point for point in points if in_bounds(things[outer], point)]
            for corners, closed in solids if points else ():
                if closed and any(inside(corners, point) for point in points):
                    return -DEEP
        return float(gap)

    def sweep(
        self,
        states: Array,
        times: Array,
        approach_start: float,
        support: set[str],
        tolerances: Tolerances,
        block: int = 20,
    ) -> list[str]:
        """Collisions at the states, one sentence per pair of links and solids.

        Distances at a block's first state tell which pairs can meet within the block at all, and
        each distance how many states later the pair can meet at the earliest.
        """
        model, geometry = self.robot.model, self.geometry
        data, shapes = model.createData(), geometry.createData()
        pairs = [(p.first, p.second) for p in geometry.collisionPairs]
        for request in shapes.distanceRequests:
            request.enable_signed_distance = True
        on_support = np.array(
            [
                self.links[i] == "object"
                and self.links[j] == WORLD
                and geometry.geometryObjects[j].name.split("/", 2)[2] in support
                for i, j in pairs
            ]
        )
        found: dict[tuple[str, str], str] = {}
        reachable = 2 * (block * tolerances.step) + tolerances.penetration
        middles = [np.array(thing.geometry.aabb_center) for thing in geometry.geometryObjects]
        radii = np.array([thing.geometry.aabb_radius for thing in geometry.geometryObjects])
        both = np.array(pairs, dtype=int).reshape(-1, 2)
        next_look = np.zeros(len(pairs), dtype=int)
        next_near = np.zeros(len(pairs), dtype=int)
        for begin in range(0, len(states), block):
            pin.updateGeometryPlacements(model, data, geometry, shapes, states[begin])
            at = np.array([T.act(m) for T, m in zip(shapes.oMg, middles, strict=True)])
            between = np.linalg.norm(at[both[:, 0]] - at[both[:, 1]], axis=1)
            near = np.flatnonzero(between <= radii[both].sum(axis=1) + reachable)
            close = []
            for k in near[next_near[near] <= begin].tolist():
                gap = self._gap(shapes, k)
                if gap <= reachable:
                    close.append(k)
                else:
                    next_near[k] = begin + int((gap - reachable) / (2 * tolerances.step))
            for row in range(begin, min(begin + block, len(states))):
                pin.updateGeometryPlacements(model, data, geometry, shapes, states[row])
                for k in close:
                    if row < next_look[k]:
                        continue
                    gap = self._gap(shapes, k)
                    next_look[k] = row + 1 + int(max(gap, 0.0) / (2 * tolerances.step))
                    allowed = tolerances.penetration
                    if on_support[k] and times[row] >= approach_start - 1e-9:
                        allowed += tolerances.contact
                    if gap < -allowed:
                        names = tuple(self._name(n) for n in pairs[k])
                        found.setdefault(
                            (names[0], names[1]),
                            f"collision: {names[0]} with {names[1]} at {times[row]:.3f} s,"
                            f" {-1000 * gap:.2f} mm deep",
                        )
        near = too_near(self, states, times, approach_start, tolerances, block)
        return [*found.values(), *near]

    def _name(self, index: int) -> str:
        if self.links[index] == WORLD:
            return str(self.geometry.geometryObjects[index].name.split("/", 2)[2])
        return self.links[index]
