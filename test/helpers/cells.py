"""Cells of poses of all sizes, and which of them hold one that stands."""

import numpy as np

from placement_planner_ros.core.contacts.placed_cells import PlacedCells
from placement_planner_ros.core.contacts.support_bounds import SupportBound
from placement_planner_ros.core.search.cell_layout import CELL, PoseSets
from placement_planner_ros.core.types import Verdict


def cells_across(regions, faces, rng, count, sizes):
    """Sets of each face on each region, and cells on the regions and across their borders.

    Args:
        faces: their number.
        sizes: m, what a cell measures at most along x and y, drawn from these.
    """
    rows = [(face, k, 0.0, 2.0 * np.pi) for k in range(len(regions)) for face in range(faces)]
    cells = []
    for _ in range(count):
        number = rng.integers(len(regions))
        size = rng.choice(sizes, 2) * rng.random(2)
        turn = rng.choice([0.0, 0.05, 0.5, 2.0 * np.pi])
        low = regions[number].sample(rng)[:2] - rng.random(2) * size
        low = np.array(
            [*(low - rng.choice([0.0, 0.1]) * rng.random(2)), rng.uniform(0.0, 2.0 * np.pi)]
        )
        cells.append((number * faces + rng.integers(faces), low, low + np.array([*size, turn])))
    return PoseSets(regions, rows, [0j] * faces), np.array(cells, dtype=CELL)


def some_pose_stands(poses, sets, cells, times=40):
    """(n,) whether any of that many random poses of each cell is stable."""
    rng = np.random.default_rng(4)
    at = np.repeat(cells, times)
    places = at["low"] + rng.random((len(at), 3)) * (at["high"] - at["low"])
    draws = sets.draws(at["set"], places)
    verdicts, _ = poses.verdicts(draws.face, draws.contact, draws.angle, draws.slope)
    return (verdicts > Verdict.UNSTABLE).reshape(-1, times).any(axis=1)


def unsupported_by(poses, sets, cells):
    """(n,) what the bound of s(x) rules out."""
    bound = SupportBound(poses.problem, poses.faces.support, poses.footing)
    return bound.unsupported(PlacedCells(sets, cells))
