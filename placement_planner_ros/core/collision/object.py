"""c_f(x): whether the object stands free at a pose and on its way straight down to it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.against_boxes import BoxArrays
from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.collision.swept_object import SweptPoses, check_poses, swept_object
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import LEVEL, ROUNDING, Array, Mask, Slope, kernel_input

_WAY_STEP_M = 0.002
"""m at most between places that are looked at on a way that is not straight down."""


class ObjectCollision:
    """The object against the obstacle set, its support excepted.

    What must keep `obstacle_margin` and `approach_stray` from every box is the object swept
    straight down, from raised to rest: convex pieces as the hull of both copies, all others as the
    triangles they have. Boxes whose top lies within `contact_tolerance` of the contact plane are
    support, wherever they are. Where the plane slopes, that of a box's points counts that reaches
    furthest above it.

    Not to be shared between threads.

    Args:
        body: the object.
        obstacles: the environment.
        settings: `obstacle_margin`, `approach_stray` and `contact_tolerance` are used.
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
        self._beneath = self.settings.obstacle_margin - ROUNDING if overhangs else math.inf
        self._obstacles = obstacles
        self._boxes: dict[Slope, BoxArrays] = {}
        self._object, self._scratch = swept_object(body)

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
        return bool(self.free_at(T_world_object, contact_height, raise_height, slope)[0])

    def free_at(
        self,
        T_world_object: Array,
        contact_height: npt.ArrayLike,
        raise_height: npt.ArrayLike,
        slope: Slope = LEVEL,
    ) -> Mask:
        """`free` for poses (n, 4, 4), with heights of shape (n,) or one for all; returns (n,)."""
        poses = kernel_input(T_world_object).reshape(-1, 4, 4)
        contact = np.array(np.broadcast_to(contact_height, len(poses)), dtype=np.float64)
        raised = np.array(np.broadcast_to(raise_height, len(poses)), dtype=np.float64)
        margin = self.settings.obstacle_margin + self.settings.approach_stray
        return self._free(SweptPoses(poses, contact, raised), self._boxes_on(slope), margin)

    def free_along(
        self, T_world_object: Array, direction: Array, length: float, boxes: BoxArrays
    ) -> bool:
        """Whether the object keeps the margin from `boxes_touching` on a straight way to a pose.

        At places on the way it keeps half of what lies between them beside the margin.

        Args:
            T_world_object: (4, 4) pose at contact.
            direction: (3,) unit, of the way back.
            length: of the way, metres.
        """
        steps = math.ceil(length / _WAY_STEP_M)
        poses = np.repeat(kernel_input(T_world_object)[None], steps + 1, axis=0)
        poses[:, :3, 3] += np.linspace(0.0, length, steps + 1)[:, None] * direction
        margin = self.settings.obstacle_margin + self.settings.approach_stray
        margin += 0.5 * length / steps if steps else 0.0
        still = np.zeros(steps + 1)
        # Where it rests is looked at first: most that meet something do there.
        return all(
            self._free(SweptPoses(poses[part], still[part], still[part]), boxes, margin).all()
            for part in (slice(0, 1), slice(1, None))
        )

    def boxes_touching(self, leant_on: Mask) -> BoxArrays:
        """The obstacle set, of which (m,) boxes may be touched."""
        return box_arrays(self._obstacles)._replace(
            tops=np.where(leant_on, 0.0, np.inf),
            support=np.array([0.0, self.settings.contact_tolerance, math.inf, math.inf]),
        )

    def _free(self, poses: SweptPoses, boxes: BoxArrays, margin: float) -> Mask:
        answers = np.empty(len(poses.T), dtype=np.bool_)
        check_poses(self._object, boxes, self._scratch, poses, margin, answers)
        return answers

    def _boxes_on(self, slope: Slope) -> BoxArrays:
        """The obstacle set with what is support, made once for each slope."""
        if slope not in self._boxes:
            under = self._beneath if slope == LEVEL else math.inf
            tolerance = self.settings.contact_tolerance
            self._boxes[slope] = box_arrays(self._obstacles)._replace(
                tops=self._obstacles.tops(slope),
                support=np.array([0.0, tolerance, self._beneath, under]),
            )
        return self._boxes[slope]
