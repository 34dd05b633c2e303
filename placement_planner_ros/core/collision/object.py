"""c_f(x): whether the object stands free at a pose and on its way straight down to it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.collision.object_kernels import (
    ObjectScratch,
    PoseMargins,
    SweptPoses,
    check_poses,
)
from placement_planner_ros.core.collision.object_solids import object_arrays
from placement_planner_ros.core.collision.separation import FREE
from placement_planner_ros.core.reach.kinematics import kernel_input
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import LEVEL, Array, Slope

_HEIGHT_ROUNDING_M = 1e-9
"""m by which heights are off by arithmetic."""
_WAY_STEP_M = 0.002
"""m at most between places that are looked at on a way that is not straight down."""


class ObjectCollision:
    """The object against the obstacle set, its support excepted.

    What must keep `collision_margin` and `approach_stray` from every box is the object swept
    straight down, from raised to rest: convex pieces as the hull of both copies, all others as the
    triangles they have. Boxes whose top lies within `contact_tolerance` of the contact plane are
    support, wherever they are. Where the plane slopes, that of a box's points counts that reaches
    furthest above it.

    Not to be shared between threads.

    Args:
        body: the object.
        obstacles: the environment.
        settings: `collision_margin`, `approach_stray` and `contact_tolerance` are used.
        overhangs: what lies beneath the object need not be farther away by the stray, which is
            sideways. The sides of a support that is smaller than the object lie in cells there.
    """

    def __init__(
        self,
        body: Body,
        obstacles: ObstacleSet,
        settings: CollisionSettings | None = None,
        *,
        overhangs: bool = False,
    ) -> None:
        self.settings = settings or CollisionSettings()
        self._beneath = (
            self.settings.collision_margin - _HEIGHT_ROUNDING_M if overhangs else math.inf
        )
        self._boxes = box_arrays(obstacles)
        self._obstacles = obstacles
        self._tops: dict[Slope, Array] = {}
        self._arrays = object_arrays(body)
        self._scratch = ObjectScratch.of(self._arrays, self._boxes.number)
        self._one_pose = np.zeros((1, 4, 4))
        self._one = np.zeros((2, 1))
        self._answer = np.zeros(1, dtype=np.int64)

    def free(
        self,
        T_world_object: Array,
        contact_height: float,
        raise_height: float,
        slope: Slope = LEVEL,
    ) -> bool:
        """Whether the object keeps the margin from `raise_height` above the pose down to it.

        True is certain. False means a collision, or a distance so close to the margin
        (`separation.BOUND_TOLERANCE_M`) that it is not certain.

        Args:
            T_world_object: (4, 4) pose at contact.
            contact_height: z of the contact plane at x = y = 0, metres.
            raise_height: how far above the pose the descent begins, metres.
            slope: of the contact plane.
        """
        self._one_pose[0] = T_world_object
        self._one[0, 0] = contact_height
        self._one[1, 0] = raise_height
        self._classify(self._one_pose, self._one[0], self._one[1], slope, self._answer)
        return bool(self._answer[0] == FREE)

    def free_at(
        self,
        T_world_object: Array,
        contact_height: npt.ArrayLike,
        raise_height: npt.ArrayLike,
        slope: Slope = LEVEL,
    ) -> npt.NDArray[np.bool_]:
        """`free` for poses (n, 4, 4), with heights of shape (n,) or one for all; returns (n,)."""
        poses = kernel_input(T_world_object).reshape(-1, 4, 4)
        contact = np.array(np.broadcast_to(contact_height, len(poses)), dtype=np.float64)
        raised = np.array(np.broadcast_to(raise_height, len(poses)), dtype=np.float64)
        answers = np.empty(len(poses), dtype=np.int64)
        self._classify(poses, contact, raised, slope, answers)
        return answers == FREE

    def free_along(
        self,
        T_world_object: Array,
        direction: Array,
        length: float,
        leant_on: npt.NDArray[np.bool_],
    ) -> bool:
        """Whether the object keeps the margin from all other boxes on a straight way to a pose.

        At places on the way it keeps half of what lies between them beside the margin.

        Args:
            T_world_object: (4, 4) pose at contact.
            direction: (3,) unit, of the way back.
            length: of the way, metres.
            leant_on: (m,) boxes that it may touch.
        """
        steps = math.ceil(length / _WAY_STEP_M)
        poses = np.repeat(kernel_input(T_world_object)[None], steps + 1, axis=0)
        poses[:, :3, 3] += np.linspace(0.0, length, steps + 1)[:, None] * direction
        margin = self.settings.collision_margin + self.settings.approach_stray
        margin += 0.5 * length / steps if steps else 0.0
        still, answers = np.zeros(steps + 1), np.empty(steps + 1, dtype=np.int64)
        check_poses(
            self._arrays,
            self._boxes,
            self._scratch,
            SweptPoses(poses, still, still, np.where(leant_on, 0.0, np.inf)),
            PoseMargins(margin, math.inf, math.inf, self.settings.contact_tolerance),
            answers,
        )
        return bool((answers == FREE).all())

    def _tops_above(self, slope: Slope) -> Array:
        """(m,) `ObstacleSet.tops`, made once for each slope."""
        if slope not in self._tops:
            self._tops[slope] = self._obstacles.tops(slope)
        return self._tops[slope]

    def _classify(
        self,
        poses: Array,
        contact: Array,
        raised: Array,
        slope: Slope,
        answers: npt.NDArray[np.int64],
    ) -> None:
        check_poses(
            self._arrays,
            self._boxes,
            self._scratch,
            SweptPoses(poses, contact, raised, self._tops_above(slope)),
            PoseMargins(
                self.settings.collision_margin + self.settings.approach_stray,
                self._beneath,
                self._beneath if slope == LEVEL else math.inf,
                self.settings.contact_tolerance,
            ),
            answers,
        )
