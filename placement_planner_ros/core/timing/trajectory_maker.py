"""From a transit path and a goal to one timed, certified trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.motion.shortcut import shorten_path
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.joint_limits import ANGULAR_ACCELERATION
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.timing.carried_point import CarriedPoint
from placement_planner_ros.core.timing.quintic import concatenate_trajectories, curve_points
from placement_planner_ros.core.timing.timing import parameterize_path
from placement_planner_ros.core.types import Array, Goal, Trajectory


@dataclass(frozen=True, slots=True)
class TimingSettings(Settings):
    """Speeds and the effort spent on short paths.

    Attributes:
        approach_scaling: share of the transit's speed used in approach and retreat.
        shortcut_attempts: random shortcuts tried.
    """

    velocity_scaling: float = setting(
        1.0, "[0.001, 1]", "", "Share of the joints' velocity limits that is used."
    )
    acceleration_scaling: float = setting(
        1.0, "[0.001, 1]", "", "Share of acceleration_limits that is used."
    )
    acceleration_limits: tuple[float, ...] = setting(
        (ANGULAR_ACCELERATION,),
        "[0.001, 10000]",
        "rad/s^2 or m/s^2",
        "One limit for all joints, or one for each joint of the arm. Left as it is, joints keep to "
        "the limit that `joint_limits` states, and those that slide to 0.5.",
    )
    approach_scaling: float = setting(0.25, "(0, 1]")
    shortcut_attempts: int = setting(50, "[0, inf)")

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if not self.acceleration_limits:
            raise ParameterError("acceleration_limits", (), "give at least one")

    @property
    def chosen(self) -> bool:
        """Whether acceleration_limits say more than nothing."""
        return self.acceleration_limits != (ANGULAR_ACCELERATION,)

    def accelerations(self, arm: Arm) -> Array:
        """(dof,) the arm's acceleration limits, unscaled, rad/s² or m/s².

        Raises:
            ParameterError: there are neither one nor as many as the arm has joints.
        """
        if not self.chosen:
            return arm.acceleration
        limits = np.array(self.acceleration_limits)
        if limits.size not in (1, arm.dof):
            raise ParameterError(
                "acceleration_limits",
                list(self.acceleration_limits),
                f"give one value, or {arm.dof} for arm {arm.name}",
            )
        return np.broadcast_to(limits, (arm.dof,))


@dataclass(frozen=True, slots=True, eq=False)
class TimedMotion:
    """What a controller is to execute.

    Attributes:
        trajectory: transit and approach, at rest between them.
        approach_start: seconds into the trajectory at which the approach begins.
        retreat: from where it ends, rest to rest, the hand open; None without.
    """

    trajectory: Trajectory
    approach_start: float
    retreat: Trajectory | None


class TrajectoryMaker:
    """Shortens, times and certifies what a controller is to execute.

    Args:
        max_acceleration: of the held object's centre of mass, m/s²; 0 for any.
    """

    def __init__(
        self, settings: TimingSettings, max_acceleration: float, rng: np.random.Generator
    ) -> None:
        self._settings = settings
        self._max_acceleration = max_acceleration
        self._rng = rng

    def make(
        self, path: Array, goal: Goal, holding: Holding, should_stop: Callable[[], bool]
    ) -> TimedMotion | None:
        """Time transit, approach and retreat.

        Args:
            path: (n, dof) from q_0 to the goal's raised pre-placement, edges certified.

        Returns:
            The motion; None if its timed curve could not be certified, or if it was stopped. A
            retreat that could not be certified is left out, where the goal may do without.
        """
        settings = self._settings
        # A shorter path.
        path = shorten_path(
            path,
            holding.transit_free,
            self._rng,
            settings.shortcut_attempts,
            should_stop,
            constraint=holding.upright,
        )
        # The transit, by limits scaled for it.
        fastest = settings.accelerations(holding.arm) * settings.acceleration_scaling
        limits = np.array([holding.arm.velocity * settings.velocity_scaling, fastest])

        joints, carried = holding.arm.joints, self._carried(holding)
        transit = parameterize_path(path, joints, limits, holding.timed_free, should_stop, carried)
        if transit is None:
            return None
        # The approach, slower, with contact allowed.
        slow = settings.approach_scaling * limits
        touching = partial(holding.timed_free, contact=True)
        approach = parameterize_path(goal.approach, joints, slow, touching, should_stop, carried)
        if approach is None:
            return None
        # The timed approach stays on its line.
        curve = curve_points(approach)
        if not holding.comes_straight_down(curve, goal.T_world_object, np.array(goal.opening)):
            return None
        # The retreat, if there is one.
        retreat = None
        if goal.retreat is not None:
            leaving_free = holding.open_hand.edge_free(
                goal.grasp, goal.T_world_object, goal.retreat
            )
            retreat = parameterize_path(goal.retreat, joints, slow, leaving_free, should_stop)
        if retreat is None and (holding.require_retreat or should_stop()):
            return None
        return TimedMotion(concatenate_trajectories(transit, approach), transit.duration, retreat)

    def _carried(self, holding: Holding) -> CarriedPoint | None:
        """The centre of mass of the held object, where its acceleration is limited."""
        if self._max_acceleration <= 0.0:
            return None
        T_tip_object = holding.arm.grasps[holding.grasp]
        center = T_tip_object.act(np.asarray(holding.held.body.center_of_mass))
        return CarriedPoint(holding.chain, center, self._max_acceleration)
