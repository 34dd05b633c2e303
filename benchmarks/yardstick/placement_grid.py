"""Every placement pose of a problem on a dense grid, and which of them the pose checks let pass."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.clearance import ClearanceField
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.types import LEVEL, Array, Verdict


@dataclass(frozen=True, slots=True)
class GridResolution:
    """How dense.

    Attributes:
        step: between positions, metres.
        turn: between angles, rad.
    """

    step: float = 0.005
    turn: float = math.radians(2.0)


@dataclass(frozen=True, slots=True, eq=False)
class GridPlacements:
    """Poses in V that are stable and free of collision.

    Attributes:
        face: (m,) index of the placement face.
        contact: (m, 3) position of its reference vertex, metres.
        angle: (m,) θ, rad.
        clearance: (m,) C(x), metres.
        tried: poses of the grid, feasible or not.
    """

    face: npt.NDArray[np.int64]
    contact: Array
    angle: Array
    clearance: Array
    tried: int


def region_grid(region: Region, step: float) -> Array:
    """(n, 3) points of a square lattice on the region, and each rectangle's middle."""
    points = []
    for x0, y0, x1, y1 in region.rectangles:
        x, y = np.meshgrid(
            _multiples_within(x0, x1, step), _multiples_within(y0, y1, step), indexing="ij"
        )
        points.append(np.column_stack([x.ravel(), y.ravel()]))
        points.append(np.array([[(x0 + x1) / 2, (y0 + y1) / 2]]))
    xy = np.unique(np.vstack(points), axis=0)
    return np.column_stack([xy, region.heights(xy)])


def grid_placements(
    problem: Problem, resolution: GridResolution, settings: PlannerSettings
) -> GridPlacements:
    """Check V, s(x) and c_f(x) at every grid pose of every face on every level region."""
    environment, body = problem.environment, problem.body
    least = settings.approach.approach_minimum
    constraints = PoseConstraints(problem, settings.collision, settings.footing, least)
    field = ClearanceField(environment.obstacles, problem.volume, beyond=0.0)
    angles = np.arange(0.0, 2.0 * math.pi - 1e-9, resolution.turn)
    found = [(np.empty(0), np.empty((0, 3)), np.empty(0), np.empty(0))]
    tried = 0
    for region in environment.regions:
        if region.slope != LEVEL:
            continue
        points = region_grid(region, resolution.step)
        tried += len(points) * len(angles) * len(body.faces)
        for face, angle in itertools.product(range(len(body.faces)), angles):
            row = np.full(len(points), face), points, np.full(len(points), angle)
            verdicts, T = constraints.verdicts(*row)
            free = verdicts == Verdict.FEASIBLE
            if free.any():
                clearance, _ = field.mean_clearance_batch(T[free], body.volume_points)
                found.append((*(column[free] for column in row), clearance))
    faces, contacts, turns, clearances = (np.concatenate(c) for c in zip(*found, strict=True))
    return GridPlacements(faces.astype(np.int64), contacts, turns, clearances, tried)


def _multiples_within(low: float, high: float, step: float) -> Array:
    return np.asarray(np.arange(math.ceil(low / step), math.floor(high / step) + 1) * step)
