"""The quintics a controller plays: shape, limits, states along them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .robot import RobotModel
from .task import Array, Curve, Tolerances


def quintic(curve: Curve, segment: int, t: Array) -> tuple[Array, Array, Array]:
    """Position, velocity, acceleration (k, joints), t seconds into a segment."""
    h = curve.times[segment + 1] - curve.times[segment]
    p0, p1 = curve.positions[segment : segment + 2]
    v0, v1 = curve.velocities[segment : segment + 2]
    a0, a1 = curve.accelerations[segment : segment + 2]
    d = p1 - p0 - v0 * h - a0 * h**2 / 2
    e = (v1 - v0 - a0 * h) * h
    f = (a1 - a0) * h**2
    c3 = (10 * d - 4 * e + f / 2) / h**3
    c4 = (-15 * d + 7 * e - f) / h**4
    c5 = (6 * d - 3 * e + f / 2) / h**5
    s = np.asarray(t)[:, None]
    return (
        p0 + v0 * s + a0 * s**2 / 2 + c3 * s**3 + c4 * s**4 + c5 * s**5,
        v0 + a0 * s + 3 * c3 * s**2 + 4 * c4 * s**3 + 5 * c5 * s**4,
        a0 + 6 * c3 * s + 12 * c4 * s**2 + 20 * c5 * s**3,
    )


def check_curve(robot: RobotModel, curve: Curve, name: str) -> list[str]:
    """What keeps a curve from being one at all."""
    found = []
    times = np.asarray(curve.times)
    values = [curve.positions, curve.velocities, curve.accelerations]
    if any(np.shape(v) != (len(times), len(curve.joints)) for v in values):
        return [f"{name}: positions, velocities, accelerations differ in shape"]
    if len(times) < 2:
        return [f"{name}: fewer than two points"]
    if not all(np.isfinite(v).all() for v in [times, *values]):
        return [f"{name}: not finite"]
    unknown = [joint for joint in curve.joints if joint not in robot.index]
    if unknown:
        return [f"{name}: unknown joints {unknown}"]
    if not (np.diff(times) > 0).all():
        found.append(f"{name}: times do not increase strictly")
    if times[0] < 0:
        found.append(f"{name}: begins before 0")
    return found


def check_limits(robot: RobotModel, curve: Curve, tolerances: Tolerances) -> list[str]:
    """Ranges, speeds and accelerations of the joints, between the points too."""
    found = []
    columns = [robot.index[name] for name in curve.joints]
    lower, upper = robot.model.lowerPositionLimit, robot.model.upperPositionLimit
    speed = robot.model.velocityLimit[columns]
    limit = tolerances.acceleration_limit
    strength = np.array([limit[n] if isinstance(limit, Mapping) else limit for n in curve.joints])
    parts = [
        quintic(curve, i, np.linspace(0, duration, 33))
        for i, duration in enumerate(np.diff(curve.times))
    ]
    q, v, a = (np.vstack([part[k] for part in parts]) for k in range(3))
    slack = tolerances.limit
    for k, (name, column) in enumerate(zip(curve.joints, columns, strict=True)):
        margin = 1e-6 + slack * 1e-2
        if q[:, k].min() < lower[column] - margin or q[:, k].max() > upper[column] + margin:
            found.append(f"limits: {name} leaves its range")
        top = np.abs(v[:, k]).max()
        if top > speed[k] * (1 + slack) + 1e-6:
            found.append(f"limits: {name} turns at {top:.4g}, allowed {speed[k]:.4g}")
        top = np.abs(a[:, k]).max()
        if top > strength[k] * (1 + slack) + 1e-6:
            found.append(f"limits: {name} accelerates at {top:.4g}, allowed {strength[k]:.4g}")
    return found


def states_along(
    robot: RobotModel, curve: Curve, q_rest: Array, object_vertices: Array, step: float
) -> tuple[Array, Array]:
    """(k, nq) states along the curve, no point moving more than `step` between two; times.

    Joints that are not the curve's stand as in q_rest (nq,).
    """
    columns = [robot.index[name] for name in curve.joints]
    reach = robot.reach(object_vertices)[columns]
    rows, times = [], []
    for segment, duration in enumerate(np.diff(curve.times)):
        coarse = quintic(curve, segment, np.linspace(0, duration, 41))[0]
        travelled = np.concatenate([[0], np.cumsum(np.abs(np.diff(coarse, axis=0)) @ reach)])
        count = max(int(np.ceil(1.05 * travelled[-1] / step)), 1)
        wanted = np.arange(count) / count * travelled[-1]
        rising = travelled + np.linspace(0, 1e-12, len(travelled))
        t = np.interp(wanted, rising, np.linspace(0, duration, 41))
        rows.append(quintic(curve, segment, t)[0])
        times.append(curve.times[segment] + t)
    moving = np.vstack([*rows, curve.positions[-1:]])
    states = np.tile(q_rest, (len(moving), 1))
    states[:, columns] = moving
    robot.fill_mimics(states)
    return states, np.concatenate([*times, curve.times[-1:]])
