"""One arm as a serial chain: forward kinematics and Jacobians in compiled kernels.

Every joint frame is turned so that its axis is z. With A_i (4, 4) the fixed transform from joint
i-1's moved frame to joint i's, and Z(q) a rotation about z or a translation along it,

    T_world_tip(q) = A_0 Z(q_0) A_1 Z(q_1) … A_{dof-1} Z(q_{dof-1}) A_tip

where A_0 contains everything between the root link and the first joint, all other joints of the
robot standing at q_rest. World is the frame of the robot's root link.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numba import njit

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.arm import Arm, follow_masters
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array, Mask, frozen_array, kernel_input
from placement_planner_ros.core.uncounted import Uncounted


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def chain_frames(fixed: Array, prismatic: Mask, q: Array, frames: Array) -> None:
    """Joint frames and tip at q: the module's product from left to right.

    Only x and y of each rotation are multiplied out; z is their cross product.

    Args:
        fixed: (dof + 1, 4, 4) A_0 … A_tip.
        prismatic: (dof,) bool.
        q: (dof,).
        frames: (dof + 1, 4, 4), filled: the moved frame of each joint (axis z), then the tip.
            The bottom rows are left alone.
    """
    dof = len(q)
    # Rotation and position so far: the identity.
    r00, r01, r02 = 1.0, 0.0, 0.0
    r10, r11, r12 = 0.0, 1.0, 0.0
    r20, r21, r22 = 0.0, 0.0, 1.0
    px, py, pz = 0.0, 0.0, 0.0
    for i in range(dof + 1):
        # The origin moves by A's translation.
        A = fixed[i]
        px += r00 * A[0, 3] + r01 * A[1, 3] + r02 * A[2, 3]
        py += r10 * A[0, 3] + r11 * A[1, 3] + r12 * A[2, 3]
        pz += r20 * A[0, 3] + r21 * A[1, 3] + r22 * A[2, 3]
        # The first two columns of the rotation times A's.
        x0 = r00 * A[0, 0] + r01 * A[1, 0] + r02 * A[2, 0]
        x1 = r10 * A[0, 0] + r11 * A[1, 0] + r12 * A[2, 0]
        x2 = r20 * A[0, 0] + r21 * A[1, 0] + r22 * A[2, 0]
        y0 = r00 * A[0, 1] + r01 * A[1, 1] + r02 * A[2, 1]
        y1 = r10 * A[0, 1] + r11 * A[1, 1] + r12 * A[2, 1]
        y2 = r20 * A[0, 1] + r21 * A[1, 1] + r22 * A[2, 1]
        # The third is their cross product.
        r02, r12, r22 = x1 * y2 - x2 * y1, x2 * y0 - x0 * y2, x0 * y1 - x1 * y0
        # The tip has no joint to move.
        if i == dof:
            r00, r10, r20, r01, r11, r21 = x0, x1, x2, y0, y1, y2
        elif prismatic[i]:
            r00, r10, r20, r01, r11, r21 = x0, x1, x2, y0, y1, y2
            # A joint that slides moves the origin along z.
            px += q[i] * r02
            py += q[i] * r12
            pz += q[i] * r22
        else:
            # A joint that turns mixes the first two columns.
            c, s = math.cos(q[i]), math.sin(q[i])
            r00, r10, r20 = c * x0 + s * y0, c * x1 + s * y1, c * x2 + s * y2
            r01, r11, r21 = c * y0 - s * x0, c * y1 - s * x1, c * y2 - s * x2
        # The moved frame.
        F = frames[i]
        F[0, 0], F[0, 1], F[0, 2], F[0, 3] = r00, r01, r02, px
        F[1, 0], F[1, 1], F[1, 2], F[1, 3] = r10, r11, r12, py
        F[2, 0], F[2, 1], F[2, 2], F[2, 3] = r20, r21, r22, pz


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def to_world(T: Array, joint: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point (x, y, z) of frame `joint` of `chain_frames`, whose poses are T."""
    return (
        T[joint, 0, 3] + T[joint, 0, 0] * x + T[joint, 0, 1] * y + T[joint, 0, 2] * z,
        T[joint, 1, 3] + T[joint, 1, 0] * x + T[joint, 1, 1] * y + T[joint, 1, 2] * z,
        T[joint, 2, 3] + T[joint, 2, 0] * x + T[joint, 2, 1] * y + T[joint, 2, 2] * z,
    )


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def frames_jacobian(
    frames: Array, prismatic: Mask, x: float, y: float, z: float, jacobian: Array
) -> None:
    """Jacobian of a point carried by the tip: z_i × (p - o_i) above z_i, or z_i where it slides.

    Args:
        frames: (dof + 1, 4, 4) of `chain_frames`: axes z_i through o_i.
        prismatic: (dof,) bool.
        x, y, z: the point p in the world.
        jacobian: (6, dof), filled: linear then angular velocity, in world axes.
    """
    for i in range(len(prismatic)):
        F = frames[i]
        zx, zy, zz = F[0, 2], F[1, 2], F[2, 2]
        # A joint that slides moves the point along its axis.
        if prismatic[i]:
            jacobian[0, i], jacobian[1, i], jacobian[2, i] = zx, zy, zz
            jacobian[3, i], jacobian[4, i], jacobian[5, i] = 0.0, 0.0, 0.0
        else:
            # A joint that turns: z_i × (p - o_i), and z_i.
            dx, dy, dz = x - F[0, 3], y - F[1, 3], z - F[2, 3]
            jacobian[0, i] = zy * dz - zz * dy
            jacobian[1, i] = zz * dx - zx * dz
            jacobian[2, i] = zx * dy - zy * dx
            jacobian[3, i], jacobian[4, i], jacobian[5, i] = zx, zy, zz


@njit(cache=True, nogil=True)
def _forward_batch(fixed: Array, prismatic: Mask, Q: Array, tips: Array) -> None:
    """Tips (n, 4, 4), zero before, of Q (n, dof)."""
    frames = np.zeros((len(prismatic) + 1, 4, 4))
    for k in range(len(Q)):
        # The tip of each configuration.
        chain_frames(fixed, prismatic, Q[k], frames)
        for a in range(3):
            for b in range(4):
                tips[k, a, b] = frames[-1, a, b]
        tips[k, 3, 3] = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """The serial chain of one arm; the robot's other joints stand at q_rest.

    Chains are equal where all values are.

    Attributes:
        joints: (dof) names, root to tip.
        fixed: (dof + 1, 4, 4) A_0 … A_tip of the module's formula.
        prismatic: (dof,) bool; the others are revolute.
        lower, upper: (dof,) joint limits, rad or m.
        ties: (k, 4) of `Arm`.
    """

    joints: tuple[str, ...]
    fixed: Array
    prismatic: Mask
    lower: Array
    upper: Array
    ties: Array

    def __post_init__(self) -> None:
        dof = len(self.joints)
        object.__setattr__(self, "ties", frozen_array(self.ties, (len(self.ties), 4)))
        object.__setattr__(self, "fixed", frozen_array(self.fixed, (dof + 1, 4, 4)))
        prismatic = np.array(self.prismatic, dtype=np.bool_)
        prismatic.setflags(write=False)
        object.__setattr__(self, "prismatic", prismatic)
        for name in ("lower", "upper"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (dof,)))

    @classmethod
    def from_robot(cls, robot: Robot, arm: Arm, q_rest: Array) -> Chain:
        """The chain of `arm` of `robot`, all other joints at q_rest (nq,).

        Raises:
            RobotError: q_rest has the wrong length.
        """
        q = np.array(q_rest, dtype=np.float64)
        if q.shape != (robot.model.nq,):
            raise RobotError(
                "q_rest", q.shape, f"give {robot.model.nq} values: {robot.joint_names}"
            )
        q[arm.q_index] = 0.0
        return _make_chain(robot, arm, q.tobytes())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Chain) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    @property
    def _content(self) -> tuple[Hashable, ...]:
        arrays = (self.fixed, self.prismatic, self.lower, self.upper, self.ties)
        return (self.joints, *(array.tobytes() for array in arrays))

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joints)

    def random(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """(*shape, dof) configurations, uniform within the limits."""
        Q = rng.uniform(self.lower, self.upper, (*shape, self.dof))
        return follow_masters(self.ties, Q)

    @property
    def freedom(self) -> int:
        """Directions of 6 in which joints move the tip, at most: the rank of the Jacobian.

        What is below a millimetre, or a milliradian, for one rad or m is no motion: descriptions
        round their angles.
        """
        # Jacobians at random configurations.
        rng = np.random.default_rng(0)
        Q = rng.uniform(
            np.maximum(self.lower, -np.pi), np.minimum(self.upper, np.pi), (16, self.dof)
        )
        # What followers move counts for the joint that they follow.
        J = np.array([self.jacobian(q, np.eye(4)) for q in follow_masters(self.ties, Q)])
        for joint, other, factor, _ in self.ties.tolist():
            J[..., int(other)] += factor * J[..., int(joint)]
            J[..., int(joint)] = 0.0
        return int(np.linalg.matrix_rank(J, tol=1e-3).max())

    def forward(self, q: Array) -> Array:
        """T_world_tip (4, 4) at q (dof,)."""
        return self.forward_batch(q[None])[0]

    def forward_batch(self, Q: Array) -> Array:
        """T_world_tip (n, 4, 4) at Q (n, dof)."""
        Q = kernel_input(Q)
        tips = np.zeros((len(Q), 4, 4))
        _forward_batch(self.fixed, self.prismatic, Q, tips)
        return tips

    def jacobian(self, q: Array, T_tip_object: Array) -> Array:
        """J (6, dof) at q (dof,): velocity of the object's origin, then angular velocity.

        Both in world axes; T_tip_object is (4, 4).
        """
        out, frames = np.empty((6, self.dof)), np.zeros((self.dof + 1, 4, 4))
        chain_frames(self.fixed, self.prismatic, kernel_input(q), frames)
        x, y, z = (frames[-1] @ T_tip_object)[:3, 3].tolist()
        frames_jacobian(frames, self.prismatic, x, y, z, out)
        return out


@functools.lru_cache(maxsize=16)
def _make_chain(robot: Robot, arm: Arm, q_zero: bytes) -> Chain:
    """The chain with `arm` at zero and the rest of the robot as in q (nq,)."""
    model, data, q = robot.model, robot.model.createData(), np.frombuffer(q_zero)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    prismatic = np.isin(arm.joints, list(robot.prismatic))
    # The frame of each joint turned so that its axis, which its Jacobian has, is along z.
    frames = [pin.SE3.Identity()]
    for index, slides in zip(arm.q_index.tolist(), prismatic, strict=True):
        axis = data.J[:3, index] if slides else data.J[3:, index]
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        across /= np.linalg.norm(across)
        R = np.column_stack([across, np.cross(axis, across), axis])
        frames.append(pin.SE3(R, data.oMi[index + 1].translation))  # joint 0 is the universe
    frames.append(data.oMf[robot.frame_id(arm.tip_frame)])
    # Transforms from each to the next, the tip last.
    fixed = [(a.inverse() * b).homogeneous for a, b in itertools.pairwise(frames)]
    return Chain(arm.joints, np.array(fixed), prismatic, arm.lower, arm.upper, arm.ties)
