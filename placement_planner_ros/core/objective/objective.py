"""Objectives ξ: clearance (maximised or minimised) and any user-given black box of poses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Protocol, runtime_checkable

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import Array, TargetVolume

ENTRY_POINT_GROUP = "placement_planner_ros.objectives"


class Objective(Protocol):
    """ξ: SE(3) → ℝ, to be maximised. A black box: any callable of a pose will do."""

    def __call__(self, T_world_object: pin.SE3) -> float:
        """ξ(x); must be finite."""
        ...


@runtime_checkable
class BatchObjective(Objective, Protocol):
    """An objective that judges many poses at once."""

    def values(self, T_world_object: Array) -> Array:
        """(n,) ξ of the (n, 4, 4) poses; must be finite."""
        ...


@runtime_checkable
class EstimatedObjective(BatchObjective, Protocol):
    """An objective that can tell roughly, for less, what it would answer."""

    def estimates(self, T_world_object: Array) -> Array:
        """(n,) about ξ of the (n, 4, 4) poses."""
        ...


@runtime_checkable
class DifferentiableObjective(Objective, Protocol):
    """An objective that knows ∂ξ/∂(x, y, e_z)."""

    def gradient(self, T_world_object: pin.SE3) -> Array:
        """(3,) change of ξ per metre in x and y, and per radian about z through the origin."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class ObjectiveContext:
    """What an objective may look at when it is made, once per run."""

    environment: Environment
    volume: TargetVolume
    body: Body


class Clearance:
    """ξ = ±C(x), the mean distance d_S over the object's volume points B_o.

    Args:
        sign: +1 maximises clearance, -1 minimises it.
    """

    def __init__(self, context: ObjectiveContext, sign: float) -> None:
        self._field = context.environment.clearance
        self._points = context.body.volume_points
        self._some_points = thinned(self._points)
        self._sign = sign

    def __call__(self, T_world_object: pin.SE3) -> float:
        """±C(x), metres."""
        value, _ = self._field.mean_clearance(T_world_object.homogeneous, self._points)
        return self._sign * value

    def values(self, T_world_object: Array) -> Array:
        """(n,) ±C of the (n, 4, 4) poses, metres."""
        values, _ = self._field.mean_clearance_batch(T_world_object, self._points)
        return self._sign * values

    def estimates(self, T_world_object: Array) -> Array:
        """(n,) ±C over a few hundred of B_o, metres."""
        values, _ = self._field.mean_clearance_batch(T_world_object, self._some_points)
        return self._sign * values

    def gradient(self, T_world_object: pin.SE3) -> Array:
        """±∂C/∂(x, y, e_z)."""
        _, gradient = self._field.mean_clearance(T_world_object.homogeneous, self._points)
        return np.asarray(self._sign * gradient)


def thinned(points: Array) -> Array:
    """Every second, fourth or eighth of the (n, 3) voxel centres, spread evenly, 300 at least."""
    share = next((s for s in (8, 4, 2) if len(points) >= 300 * s), 1)
    index = [np.unique(np.round(line, 6), return_inverse=True)[1] for line in points.T]
    return np.asarray(points[(index[0] + 3 * index[1] + 5 * index[2]) % share == 0])


ObjectiveFactory = Callable[[ObjectiveContext], Objective]

_BUILT_IN: dict[str, ObjectiveFactory] = {
    "maximize_clearance": lambda context: Clearance(context, 1.0),
    "minimize_clearance": lambda context: Clearance(context, -1.0),
}


def objective_names() -> list[str]:
    """Every name `make_objective` knows: the built-in ones and the installed plug-ins."""
    return sorted({*_BUILT_IN, *(e.name for e in _plug_ins())})


def make_objective(name: str, context: ObjectiveContext) -> Objective:
    """Make the objective of that name for one run.

    Raises:
        ParameterError: the name is unknown, or what its entry point makes cannot be called.
    """
    factory = _BUILT_IN.get(name)
    if factory is None:
        found = [e for e in _plug_ins() if e.name == name]
        if not found:
            known = ", ".join(objective_names())
            raise ParameterError("objective", name, f"is not known; choose one of {known}")
        factory = found[0].load()
    objective = factory(context)
    if not callable(objective):
        raise ParameterError(
            "objective", name, f"its factory made a {type(objective).__name__}, not a callable"
        )
    return objective


@cache
def _plug_ins() -> tuple[EntryPoint, ...]:
    """What is installed; looked for once, as that takes some 20 ms."""
    return tuple(entry_points(group=ENTRY_POINT_GROUP))


def evaluate(objective: Objective, T_world_object: pin.SE3) -> float:
    """ξ(x), checked.

    Raises:
        ParameterError: the objective is not a finite number there.
    """
    value = float(objective(T_world_object))
    if not math.isfinite(value):
        raise ParameterError(
            "objective", value, f"must be finite, at position {T_world_object.translation.tolist()}"
        )
    return value


def evaluate_batch(objective: Objective, T_world_object: Array) -> Array:
    """(n,) ξ of the (n, 4, 4) poses, checked; a black box is asked pose by pose.

    Raises:
        ParameterError: the objective is not a finite number somewhere.
    """
    if not isinstance(objective, BatchObjective):
        return np.array([evaluate(objective, pin.SE3(T)) for T in T_world_object])
    values = np.asarray(objective.values(T_world_object), dtype=np.float64)
    if values.shape != (len(T_world_object),) or not np.isfinite(values).all():
        raise ParameterError(
            "objective", values.tolist(), f"must be {len(T_world_object)} finite numbers"
        )
    return values


def gradient(
    objective: Objective,
    T_world_object: pin.SE3,
    step: float = 1e-3,
    angle_step: float = 5e-3,
) -> Array:
    """∂ξ/∂(x, y, e_z) (3,): the objective's own, or central differences.

    Args:
        step: of the differences in x and y, metres.
        angle_step: of the differences in e_z, radians.
    """
    if isinstance(objective, DifferentiableObjective):
        return np.asarray(objective.gradient(T_world_object), dtype=np.float64)
    result = np.zeros(3)
    for axis, size in enumerate((step, step, angle_step)):
        change = np.zeros(3)
        change[axis] = size
        ahead = evaluate(objective, moved(T_world_object, change))
        behind = evaluate(objective, moved(T_world_object, -change))
        result[axis] = (ahead - behind) / (2.0 * size)
    return result


def moved(T_world_object: pin.SE3, change: Array) -> pin.SE3:
    """The pose shifted by change[:2] metres and turned by change[2] about z through its origin."""
    rotation = pin.utils.rotate("z", float(change[2])) @ T_world_object.rotation
    translation = T_world_object.translation + np.array([change[0], change[1], 0.0])
    return pin.SE3(rotation, translation)
