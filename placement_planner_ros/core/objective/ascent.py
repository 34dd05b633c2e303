"""Following ∂ξ/∂(x, y, e_z) uphill, with a step that grows and shrinks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.objective.objective import Objective, objective_gradient
from placement_planner_ros.core.settings import Settings, setting
from placement_planner_ros.core.types import LEVEL, Array, Slope

_MASKS = np.array([(1, 1, 1), (1, 1, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class AscentSettings(Settings):
    """Step control.

    Attributes:
        first_step: length of the first step, and of the longest.
        last_step: the ascent ends once steps are shorter than this.
        turn_radius: metres that one radian of e_z counts as.
        max_steps: trial steps at most.
    """

    first_step: float = setting(0.02, "(0, inf)", "m")
    last_step: float = setting(1e-3, "(0, inf)", "m")
    turn_radius: float = setting(0.1, "(0, inf)", "m")
    max_steps: int = setting(100, "[0, inf)")

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.last_step > self.first_step:
            raise ParameterError("last_step", self.last_step, "must be in (0, first_step]")


def climb_objective(
    objective: Objective,
    x: pin.SE3,
    attempt: Callable[[Array], pin.SE3 | None],
    settings: AscentSettings,
    should_stop: Callable[[], bool],
    slope: Slope = LEVEL,
) -> None:
    """Offer changes of the pose that lead uphill until none is taken any more.

    Args:
        x: where to begin.
        attempt: given a change in (x, y, e_z), takes it and returns the pose reached, or None.
        slope: of the plane in which the pose is moved.
    """
    step = settings.first_step
    directions = ascent_directions(objective, x, settings.turn_radius, slope)
    # Every direction at one step; then with a step of half the length.
    untried: Iterator[Array] = iter(directions)
    for _ in range(settings.max_steps):
        if should_stop():
            return
        direction = next(untried, None)
        if direction is None:
            step /= 2.0
            if step < settings.last_step or not len(directions):
                return
            untried = iter(directions)
            continue
        # Where a step is taken, start again from there with a longer one.
        reached = attempt(step * direction)
        if reached is None:
            continue
        step = min(2.0 * step, settings.first_step)
        directions = ascent_directions(objective, reached, settings.turn_radius, slope)
        untried = iter(directions)


def ascent_directions(
    objective: Objective, x: pin.SE3, turn_radius: float, slope: Slope = LEVEL
) -> Array:
    """(k, 3) ascent directions in (x, y, e_z): the gradient, then its components.

    At a wall the gradient itself is blocked while one of its components still is free. Each is of
    unit length, a radian counting as `turn_radius` metres.
    """
    # The gradient and its components, in metres.
    scale = np.array([1.0, 1.0, 1.0 / turn_radius])
    masked = objective_gradient(objective, x, slope=slope) * scale * _MASKS
    lengths = np.linalg.norm(masked, axis=1)
    kept = lengths > 1e-9
    return np.asarray(masked[kept] / lengths[kept, None] * scale)
