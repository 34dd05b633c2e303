"""ξ, what the planner asks of an objective: a value per pose, and what else it may know."""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.errors import ParameterError, sayable
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import LEVEL, Array, Slope, TargetVolume, upright
from placement_planner_ros.core.wishes.settings import WishSettings

_Said = TypeVar("_Said")

_DIFFERENCES = np.array([1e-3, 1e-3, 5e-3])
"""m, m and rad to either side, which gradients are taken from."""


class Objective(Protocol):
    """ξ: SE(3) → ℝ, to be maximised. A black box: any callable of a pose will do."""

    def __call__(self, T_world_object: pin.SE3) -> float:
        """ξ(x); must be finite."""
        ...


class BatchObjective(Protocol):
    """What judges many poses at once: an objective, or a term of one."""

    def values(self, T_world_object: Array) -> Array:
        """(n,) ξ of the (n, 4, 4) poses; must be finite."""
        ...


@runtime_checkable
class EstimatedObjective(BatchObjective, Protocol):
    """An objective that can tell roughly, for less, what it would answer."""

    def estimates(self, T_world_object: Array) -> Array:
        """(n,) about ξ of the (n, 4, 4) poses; where that is not above ξ_best a pose is passed
        over."""
        ...


@runtime_checkable
class BoundedObjective(BatchObjective, Protocol):
    """An objective that computes no more than it takes to know what is better than the best."""

    def values_above(self, T_world_object: Array, best: float) -> Array:
        """(n,) ξ of the (n, 4, 4) poses; where that is not above `best`, anything that is neither,
        and no less than ξ."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PoseRanges:
    """n ranges of poses, each around a middle one: within the plane that the object stands on.

    Attributes:
        T: (n, 4, 4) the middles, T_world_object.
        pivot: (n, 3) points of the plane, fixed to the object, about which it turns.
        axis: (n, 3) normals of the planes.
        shift: (n,) how far the pivot is from where it is in the middle at most, seen from above, m.
        turn: (n,) by how much the object is turned from there at most, rad.
        rise: (n,) how much higher or lower the pivot is at most, m.
        away: (n,) how far the object's origin is from where it is in the middle at most, m.
    """

    T: Array
    pivot: Array
    axis: Array
    shift: Array
    turn: Array
    rise: Array
    away: Array

    @property
    def chord(self) -> Array:
        """(n,) how far turning takes a point at distance 1 from the axis at most."""
        return np.asarray(2.0 * np.sin(0.5 * np.minimum(self.turn, math.pi)))


@runtime_checkable
class SlowObjective(Objective, Protocol):
    """An objective that is known to change little from a pose to those around it.

    Attributes:
        bounded: False: it may be anything for all that is known.
    """

    bounded: bool

    def most_around(self, ranges: PoseRanges, rough: bool = False) -> Array:
        """(n,) what it does not exceed at any pose of each range; where a rough answer will do, by
        its estimates if it has any."""
        ...


@runtime_checkable
class TermedObjective(Protocol):
    """What is made of terms."""

    def terms(self, T_world_object: pin.SE3) -> dict[str, float]:
        """The value of each by its name, in its own unit."""
        ...


@runtime_checkable
class DifferentiableObjective(Protocol):
    """An objective, or a term, that knows its ∂/∂(x, y, e_z)."""

    def gradient(self, T_world_object: pin.SE3) -> Array:
        """(3,) change of ξ per metre in x and y, and per radian about z through the origin."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ObjectiveContext:
    """What an objective may look at when it is made, once per run.

    Attributes:
        environment: what is known of the surroundings.
        volume: the target volume V, with its corners `lower` and `upper`.
        body: the object.
        wishes: what a weighted one is made of.
        support, contact_tolerance: as in the planner's settings; metres.
    """

    environment: Environment
    volume: TargetVolume
    body: Body
    wishes: WishSettings = field(default_factory=WishSettings)
    support: str = "vertices"
    contact_tolerance: float = 0.003


def ask_objective(objective: object, ask: Callable[[], _Said]) -> _Said:
    """What an objective answers; of somebody else's code, whatever it raises is its fault.

    Raises:
        ParameterError: it raised something, which is the error's cause.
    """
    try:
        return ask()
    except ParameterError:
        raise
    except (Exception, GeneratorExit, SystemExit) as error:
        if type(objective).__module__.startswith(f"{__package__}."):
            raise
        remedy = "the objective raised this; mend it, or choose another"
        said = sayable(traceback.format_exception_only(error)[-1].strip())
        raise ParameterError("objective", said, remedy) from error


def evaluate_objective(objective: Objective, T_world_object: pin.SE3) -> float:
    """ξ(x), checked.

    Raises:
        ParameterError: the objective raises, or is not a finite number there.
    """
    value = ask_objective(objective, lambda: float(objective(T_world_object)))
    if not math.isfinite(value):
        raise ParameterError(
            "objective", value, f"must be finite, at position {T_world_object.translation.tolist()}"
        )
    return value


def evaluate_batch(objective: Objective | BatchObjective, T_world_object: Array) -> Array:
    """(n,) ξ of the (n, 4, 4) poses, checked; a black box is asked pose by pose.

    Raises:
        ParameterError: the objective raises, or is not a finite number somewhere.
        StoppedError: nobody wants them any more.
    """
    # What `isinstance` says takes Python 3.11 as long as a batch of values.
    if hasattr(objective, "values"):
        return finite_answer(
            objective, lambda: objective.values(T_world_object), len(T_world_object)
        )
    values = []
    for T in T_world_object:
        step("asking the objective")  # one that takes long is asked no more once that is over
        values.append(evaluate_objective(objective, pin.SE3(T)))
    return np.array(values)


def estimate_batch(objective: Objective | BatchObjective, T_world_object: Array) -> Array:
    """(n,) about ξ of the (n, 4, 4) poses: its estimates, or where it has none, its values.

    Raises:
        ParameterError, StoppedError: see `evaluate_batch`.
    """
    if not hasattr(objective, "estimates"):
        return evaluate_batch(objective, T_world_object)
    return finite_answer(
        objective, lambda: objective.estimates(T_world_object), len(T_world_object)
    )


def finite_answer(objective: object, ask: Callable[[], Array], count: int) -> Array:
    """So many numbers (count,) that an objective answers, checked.

    Raises:
        ParameterError: the objective raises, or one of them is not finite.
    """
    numbers = ask_objective(objective, lambda: np.array(ask(), dtype=np.float64))
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise ParameterError("objective", numbers.tolist(), f"must be {count} finite numbers")
    return numbers


def objective_gradient(
    objective: Objective | BatchObjective, T_world_object: pin.SE3, slope: Slope = LEVEL
) -> Array:
    """∂ξ/∂(x, y, e_z) (3,) of an objective or a term: its own, or central differences.

    Args:
        slope: of the plane in which differences are taken.

    Raises:
        ParameterError: the objective raises, or is not finite.
    """
    if isinstance(objective, DifferentiableObjective):
        smooth = objective
        return finite_answer(objective, lambda: smooth.gradient(T_world_object), 3)
    # To both sides, one coordinate at a time.
    changes = [side * change for change in np.diag(_DIFFERENCES) for side in (1.0, -1.0)]
    poses = [moved_pose(T_world_object, change, slope).homogeneous for change in changes]
    ahead, behind = evaluate_batch(objective, np.array(poses)).reshape(3, 2).T
    return np.asarray((ahead - behind) / (2.0 * _DIFFERENCES))


def moved_pose(T_world_object: pin.SE3, change: Array, slope: Slope = LEVEL) -> pin.SE3:
    """The pose moved within a plane of that slope, turned about its normal through its origin.

    Args:
        change: (3,) metres along x and y, and rad.
    """
    # Turned about the normal, and moved within the plane.
    turn = pin.utils.rotate("z", float(change[2]))
    if slope != LEVEL:
        to_normal = upright(slope)
        turn = to_normal @ turn @ to_normal.T
    rise = slope[0] * change[0] + slope[1] * change[1]
    translation = T_world_object.translation + np.array([change[0], change[1], rise])
    return pin.SE3(turn @ T_world_object.rotation, translation)
