"""c_f(x): whether the object stands free at a pose and on its way straight down to it."""

from __future__ import annotations

import coal
import numpy as np
import numpy.typing as npt
import trimesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import (
    CollisionSettings,
    coal_box,
    coal_convex,
    meets,
    part_set,
)
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.collision.object_kernels import (
    ObjectArrays,
    ObjectScratch,
    check_poses,
)
from placement_planner_ros.core.collision.separation import COLLIDING, FREE
from placement_planner_ros.core.reach.kinematics import kernel_input
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array

_UNDECIDED_ROWS = 256


class ObjectCollision:
    """The object against the obstacle set, its support excepted.

    What must keep `collision_margin` from every box is the object swept straight down, from raised
    to rest. Each convex part sweeps the hull of its two copies, which is exact. Boxes whose top
    lies within `contact_tolerance` of the contact plane are support, wherever they are.

    Not to be shared between threads.

    Args:
        body: the object.
        obstacles: the environment.
        settings: `collision_margin` and `contact_tolerance` are used.
    """

    def __init__(
        self, body: Body, obstacles: ObstacleSet, settings: CollisionSettings | None = None
    ) -> None:
        self.settings = settings or CollisionSettings()
        self._parts = tuple(body.parts)
        self._boxes = box_arrays(obstacles)
        self._arrays = ObjectArrays.of([part_set(part) for part in self._parts])
        self._scratch = ObjectScratch.of(self._arrays, _UNDECIDED_ROWS)
        self._one_pose = np.zeros((1, 4, 4))
        self._one = np.zeros((2, 1))
        self._answer = np.zeros(1, dtype=np.int64)

    def free(self, T_world_object: Array, contact_height: float, raise_height: float) -> bool:
        """Whether the object keeps the margin from `raise_height` above the pose down to it.

        Args:
            T_world_object: (4, 4) pose at contact.
            contact_height: z of the contact plane, metres.
            raise_height: how far above the pose the descent begins, metres.
        """
        self._one_pose[0] = T_world_object
        self._one[0, 0] = contact_height
        self._one[1, 0] = raise_height
        self._classify(self._one_pose, self._one[0], self._one[1], self._answer)
        if self._answer[0] == FREE:
            return True
        return bool(self._answer[0] != COLLIDING) and self._resolved(raise_height)

    def free_at(
        self,
        T_world_object: Array,
        contact_height: npt.ArrayLike,
        raise_height: npt.ArrayLike,
    ) -> npt.NDArray[np.bool_]:
        """`free` for poses (n, 4, 4), with heights of shape (n,) or one for all; returns (n,)."""
        poses = kernel_input(T_world_object).reshape(-1, 4, 4)
        contact = np.array(np.broadcast_to(contact_height, len(poses)), dtype=np.float64)
        raised = np.array(np.broadcast_to(raise_height, len(poses)), dtype=np.float64)
        answers = np.empty(len(poses), dtype=np.int64)
        self._classify(poses, contact, raised, answers)
        free = answers == FREE
        for i in np.flatnonzero((answers != FREE) & (answers != COLLIDING)):
            free[i] = self.free(poses[i], contact[i], raised[i])
        return free

    def _classify(
        self, poses: Array, contact: Array, raised: Array, answers: npt.NDArray[np.int64]
    ) -> None:
        check_poses(
            self._arrays,
            self._boxes,
            self._scratch,
            poses,
            contact,
            raised,
            self.settings.collision_margin,
            self.settings.contact_tolerance,
            answers,
        )

    def _resolved(self, raise_height: float) -> bool:
        """coal's answer on the pairs that the kernel left undecided for the one pose."""
        if self._scratch.counters[0] > len(self._scratch.undecided):
            rows = 2 * int(self._scratch.counters[0])
            self._scratch = ObjectScratch.of(self._arrays, rows)
            self._classify(self._one_pose, self._one[0], self._one[1], self._answer)
        T = self._one_pose[0]
        transform = coal.Transform3s(T[:3, :3], T[:3, 3])
        swept: dict[int, coal.Convex] = {}
        for part, box in self._scratch.undecided[: self._scratch.counters[0]].tolist():
            if part not in swept:
                up = T[2, :3] * raise_height
                swept[part] = coal_convex(*swept_hull(self._parts[part].vertices, up))
            at = coal_box(self._boxes.corners[box])
            if meets(swept[part], transform, *at, self.settings.collision_margin):
                return False
        return True


def swept_hull(vertices: Array, shift: Array) -> tuple[Array, npt.NDArray[np.int_]]:
    """Vertices and outward triangles of the hull of (m, 3) vertices and their copy at `shift`."""
    hull = trimesh.convex.convex_hull(np.vstack([vertices, vertices + shift]))
    return np.asarray(hull.vertices), np.asarray(hull.faces)
