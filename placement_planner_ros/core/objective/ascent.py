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

_CONES = [
    (np.sin(away) * np.cos(turn), np.sin(away) * np.sin(turn), np.cos(away))
    for away in np.radians((45.0, 80.0))
    for turn in np.arange(6) * np.pi / 3.0
]
"""Directions so far from the third axis, all around it."""
_MASKS = np.array([(1, 1, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=np.float64)


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
    max_steps: int = setting(200, "[0, inf)")

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
    """(k, 3) ascent directions in (x, y, e_z): the gradient, its components, then some about it.

    At a wall the gradient itself is blocked while one of the others still is free. Each is of unit
    length, a radian counting as `turn_radius` metres.
    """
    # The gradient in metres, one beside it in the plane, and one across both.
    scale = np.array([1.0, 1.0, 1.0 / turn_radius])
    up = objective_gradient(objective, x, slope=slope) * scale
    if np.linalg.norm(up) <= 1e-9:
        return np.empty((0, 3))
    up /= np.linalg.norm(up)
    parts = up * _MASKS
    lengths = np.linalg.norm(parts, axis=1)
    kept = lengths > 1e-9
    beside = np.array([-up[1], up[0], 0.0]) / lengths[0] if kept[0] else np.eye(3)[0]
    about = _CONES @ np.stack([beside, np.cross(up, beside), up])
    return np.vstack([up, parts[kept] / lengths[kept, None], about]) * scale
