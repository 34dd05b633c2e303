"""From a transit path and a goal to one timed, certified trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.motion.shortcut import shorten
from placement_planner_ros.core.timing.quintic import control_points
from placement_planner_ros.core.timing.timing import concatenate, parameterize
from placement_planner_ros.core.types import Array, Goal, Trajectory


@dataclass(frozen=True, slots=True)
class ExecutionSettings:
    """Speeds and the effort spent on short paths.

    Attributes:
        velocity_scaling: share of the joints' velocity limits used, (0, 1].
        acceleration_scaling: share of the acceleration limits used, (0, 1].
        acceleration_limits: rad/s² (m/s²), one for all joints or one for each of the arm's.
        approach_scaling: share of the transit's speed used in approach and retreat, (0, 1].
        shortcut_attempts: random shortcuts tried.
    """

    velocity_scaling: float = 1.0
    acceleration_scaling: float = 1.0
    acceleration_limits: tuple[float, ...] = (5.0,)
    approach_scaling: float = 0.25
    shortcut_attempts: int = 100

    def __post_init__(self) -> None:
        for name in ("velocity_scaling", "acceleration_scaling", "approach_scaling"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise ParameterError(name, getattr(self, name), "must be in (0, 1]")
        limits = np.array(self.acceleration_limits, dtype=np.float64)
        if limits.size == 0 or not (np.isfinite(limits).all() and (limits > 0.0).all()):
            raise ParameterError(
                "acceleration_limits", self.acceleration_limits, "must be finite and above zero"
            )
        if self.shortcut_attempts < 0:
            raise ParameterError(
                "shortcut_attempts", self.shortcut_attempts, "must be zero or larger"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
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
    """Shortens, times and certifies what a controller is to execute."""

    def __init__(self, settings: ExecutionSettings, rng: np.random.Generator) -> None:
        self._settings = settings
        self._rng = rng

    def make(
        self, path: Array, goal: Goal, holding: Holding, should_stop: Callable[[], bool]
    ) -> Motion | None:
        """Time transit, approach and retreat.

        Args:
            path: (n, dof) from q_0 to the goal's raised pre-placement, edges certified.

        Returns:
            The motion; None if its timed curve could not be certified, or if it was stopped. A
            retreat that could not be certified is left out, where the goal may do without.
        """
        settings = self._settings
        path = shorten(
            path, holding.transit_free, self._rng, settings.shortcut_attempts, should_stop
        )
        velocity = holding.arm.velocity * settings.velocity_scaling
        limits = np.array(settings.acceleration_limits)
        if limits.size not in (1, len(velocity)):
            raise ParameterError(
                "acceleration_limits",
                settings.acceleration_limits,
                f"give one value, or {len(velocity)} for arm {holding.arm.name}",
            )
        acceleration = np.broadcast_to(limits, velocity.shape) * settings.acceleration_scaling

        def transit_free(a: Array, b: Array, deviation: Array) -> bool:
            return holding.collision.edge_free(a, b, deviation=deviation)

        def approach_free(a: Array, b: Array, deviation: Array) -> bool:
            return holding.collision.edge_free(a, b, contact=True, deviation=deviation)

        joints = holding.arm.joints
        transit = parameterize(
            path, joints, velocity, acceleration, transit_free, should_stop=should_stop
        )
        if transit is None:
            return None
        slow = settings.approach_scaling
        approach = parameterize(
            goal.approach,
            joints,
            slow * velocity,
            slow * acceleration,
            approach_free,
            should_stop=should_stop,
        )
        if approach is None:
            return None
        curve = control_points(
            approach.times, approach.positions, approach.velocities, approach.accelerations
        )
        if not holding.comes_straight_down(curve, goal.T_world_object):
            return None
        retreat = None
        if goal.retreat is not None:
            leaving_free = holding.open_hand.edge_free(goal.grasp, goal.T_world_object)
            retreat = parameterize(
                goal.retreat,
                joints,
                slow * velocity,
                slow * acceleration,
                leaving_free,
                should_stop=should_stop,
            )
        if retreat is None and (holding.require_retreat or should_stop()):
            return None
        return Motion(concatenate(transit, approach), transit.duration, retreat)
