"""The margin from what was measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.spatial import cKDTree

from .insides import DEEP, in_bounds, inside
from .shapes import corners_of
from .task import Array, Tolerances

if TYPE_CHECKING:
    from .world import World


def too_near(
    world: World,
    states: Array,
    times: Array,
    approach_start: float,
    tolerances: Tolerances,
    block: int,
) -> list[str]:
    """What the arm moves and brings nearer than the margin to what was measured, per link.

    Of the object on its way down its support is left out.
    """
    if world.measured is None or world.support is None:
        return []
    model, geometry = world.robot.model, world.geometry
    data, shapes = model.createData(), geometry.createData()
    request = coal.DistanceRequest()
    margin = tolerances.margin - tolerances.penetration
    corners = {i: corners_of(geometry.geometryObjects[i].geometry) for i in world.moving}
    low, high = world.measured
    tree = cKDTree(0.5 * (low + high))
    largest = 0.5 * float(np.linalg.norm(high - low, axis=1).max(initial=0.0))
    worst: dict[str, tuple[float, float]] = {}
    next_look = {i: np.zeros(len(low), dtype=int) for i in world.moving}
    nearby: dict[int, npt.NDArray[np.int64]] = {}
    for row, state in enumerate(states):
        pin.updateGeometryPlacements(model, data, geometry, shapes, state)
        for i in world.moving:
            T = shapes.oMg[i]
            if row % block == 0:
                middle = corners[i].mean(axis=0)
                radius = float(np.linalg.norm(corners[i] - middle, axis=1).max())
                radius += largest + margin + block * tolerances.step
                nearby[i] = np.array(tree.query_ball_point(T.act(middle), radius), dtype=int)
            rows = nearby[i][next_look[i][nearby[i]] <= row]
            link = world.links[i]
            if link == "object" and times[row] >= approach_start - 1e-9:
                rows = rows[~world.support[rows]]
            if len(rows) == 0:
                continue
            points = corners[i] @ T.rotation.T + T.translation
            for axis in (2, 0, 1):
                rows = rows[low[rows, axis] <= points[:, axis].max() + margin]
                rows = rows[high[rows, axis] >= points[:, axis].min() - margin]
            at = coal.Transform3s(T.rotation, T.translation)
            for box in rows.tolist():
                solid = coal.Box(high[box] - low[box])
                where = coal.Transform3s(np.eye(3), (low[box] + high[box]) / 2)
                thing = geometry.geometryObjects[i].geometry
                gap = coal.distance(thing, at, solid, where, request, coal.DistanceResult())
                center = T.actInv(pin.SE3(np.eye(3), (low[box] + high[box]) / 2)).translation
                if in_bounds(thing, center) and any(
                    closed and inside(piece, center) for piece, closed in world.pieces.get(i, [])
                ):
                    gap = -DEEP
                next_look[i][box] = row + 1 + int(max(gap - margin, 0.0) / tolerances.step)
                if gap < worst.get(link, (margin, 0.0))[0]:
                    worst[link] = gap, float(times[row])
    return [
        f"margin: {link} is {1000 * gap:.2f} mm from what was measured at {time:.3f} s"
        for link, (gap, time) in worst.items()
    ]
