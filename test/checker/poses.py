"""Where everything is at each of many states, and how far it comes from one to another."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin

from .task import Array


class Poses:
    """Of the n geometries of a pinocchio model at states (k, nq) of the robot.

    Attributes:
        middles: (k, n, 3) of the boxes around them, in the world.
        radii: (n,) of the balls around them, metres.
    """

    def __init__(self, model: pin.Model, geometry: pin.GeometryModel, states: Array) -> None:
        self._geometry = geometry
        self._joints = _forward_kinematics(model, np.asarray(states))
        self._of: dict[int, Array] = {}
        self._travel: dict[int, Array] = {}
        things = list(geometry.geometryObjects)
        parents = [thing.parentJoint for thing in things]
        local = np.array([thing.placement.act(_middle(thing)) for thing in things])
        middles = np.empty((len(things), len(self._joints), 3))  # one thing's lie together
        for i, (parent, point) in enumerate(zip(parents, local, strict=True)):
            T = self._joints[:, parent]
            middles[i] = T[:, :3, :3] @ point + T[:, :3, 3]
        self.middles = middles.swapaxes(0, 1)
        self.radii = np.array([thing.geometry.aabb_radius for thing in things])

    def of(self, i: int) -> Array:
        """(k, 4, 4) of a geometry in the world."""
        if i not in self._of:
            thing = self._geometry.geometryObjects[i]
            self._of[i] = self._joints[:, thing.parentJoint] @ thing.placement.homogeneous
        return self._of[i]

    def at(self, i: int, row: int) -> coal.Transform3s:
        """Of a geometry at a state."""
        T = self.of(i)[row]
        return coal.Transform3s(T[:3, :3], T[:3, 3])

    def travel(self, i: int) -> Array:
        """(k,) most metres any point of a geometry has come since the first state."""
        if i not in self._travel:
            self._travel[i] = self._travelled(i, self.of(i))
        return self._travel[i]

    def travel_apart(self, i: int, j: int) -> Array:
        """(k,) most metres any point of one geometry has come, seen from the other."""
        parents = [self._geometry.geometryObjects[k].parentJoint for k in (i, j)]
        if parents[0] == parents[1]:
            return np.zeros(len(self._joints))
        for one, other in ((i, j), (j, i)):
            if self.travel(other)[-1] == 0.0:
                return self.travel(one)
        larger, smaller = (i, j) if self.radii[i] >= self.radii[j] else (j, i)
        T, other = self.of(smaller), self.of(larger)
        seen = np.empty((len(T), 3, 4))
        back = np.swapaxes(other[:, :3, :3], 1, 2)
        seen[:, :, :3] = back @ T[:, :3, :3]
        seen[:, :, 3] = (back @ (T[:, :3, 3] - other[:, :3, 3])[..., None])[..., 0]
        return self._travelled(smaller, seen)

    def _travelled(self, i: int, T: Array) -> Array:
        """(k,) by poses of the geometry.

        Only the states count. A point's way from one to the next is no longer than that of the
        middle and what the ball around it turns by: |A x| <= |A| |x|, and for a difference of two
        rotations |A| is its Frobenius norm / √2.
        """
        steps = np.diff(T[:, :3], axis=0)
        thing = self._geometry.geometryObjects[i]
        moved = np.linalg.norm(steps[..., :3] @ _middle(thing) + steps[..., 3], axis=1)
        angle = np.sqrt(0.5 * np.einsum("kij,kij->k", steps[..., :3], steps[..., :3]))
        return np.concatenate([[0.0], np.cumsum(moved + self.radii[i] * angle)])


def _middle(thing: pin.GeometryObject) -> Array:
    """(3,) of the box around a geometry, in its frame."""
    return np.array(thing.geometry.aabb_center)


def _forward_kinematics(model: pin.Model, states: Array) -> Array:
    """(k, njoints, 4, 4) of joints that turn or slide, at states (k, nq).

    What a joint does at 0 and at 1 tells its twist ξ: T(q) = T(0) exp(q ξ).
    """
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(model.nq))
    at_zero = [T.copy() for T in data.liMi]
    pin.forwardKinematics(model, data, np.ones(model.nq))
    found = np.empty((len(states), model.njoints, 4, 4))
    found[:, 0] = np.eye(4)
    for joint in range(1, model.njoints):
        twist = pin.log6(at_zero[joint].actInv(data.liMi[joint])).vector
        slide, turn = twist[:3], twist[3:]
        q = states[:, model.joints[joint].idx_q]
        cross = pin.skew(turn)  # of length 1, or 0
        moved = np.tile(np.eye(4), (len(states), 1, 1))
        moved[:, :3, :3] += np.sin(q)[:, None, None] * cross
        moved[:, :3, :3] += (1.0 - np.cos(q))[:, None, None] * (cross @ cross)
        moved[:, :3, 3] = q[:, None] * slide
        local = at_zero[joint].homogeneous @ moved
        found[:, joint] = found[:, model.parents[joint]] @ local
    return found
