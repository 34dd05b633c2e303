"""Hollow objects beside and over things: their hulls would meet what they do not."""

from __future__ import annotations

import numpy as np

from benchmarks.situations.situation import (
    DARK,
    THING,
    TRAY_UPSIDE_DOWN,
    Situation,
    place,
    slab,
    standing,
    table,
    walls,
)
from placement_planner_ros.scenes.primitives import frustum, standing_box
from placement_planner_ros.scenes.scenes import Scene

Rng = np.random.Generator


def _bowl(rng: Rng, name: str, half: float, height: float, why: str, possible: bool) -> Situation:
    centre = place(rng)
    solids = (table(), *walls("frame", centre, (2 * half, 2 * half), height))
    scene = Scene(name, slab(centre, (half, half), 0.0), solids)
    pose = standing(centre) if possible else None
    return Situation(name, "hollow things", "bowl", scene, why, pose)


def bowl_over_frame(rng: Rng) -> Situation:
    half, height = rng.uniform(0.056, 0.059), rng.uniform(0.010, 0.013)
    why = "the rim of 120 mm is above the frame, the foot of 72 mm within"
    return _bowl(rng, "bowl_over_frame", half, height, why, True)


def bowl_in_high_frame(rng: Rng) -> Situation:
    half, height = rng.uniform(0.049, 0.052), rng.uniform(0.030, 0.034)
    why = f"the bowl is 111 mm wide where a frame of {2e3 * half:.0f} mm ends"
    return _bowl(rng, "bowl_in_high_frame", half, height, why, False)


def _toy_table(rng: Rng, name: str, board: tuple[float, float], can: tuple[float, float],
               why: str, possible: bool) -> Situation:  # fmt: skip
    centre, top = place(rng), 0.06
    solids = (
        table(),
        standing_box("board", (*board, top), centre, 0.0, 0.0, DARK),
        frustum("can", can[0], can[0], top, top + can[1], THING, centre),
    )
    scene = Scene(name, slab(centre, (board[0] / 2, board[1] / 2), top), solids)
    pose = standing(centre, top) if possible else None
    return Situation(name, "hollow things", "toy_table", scene, why, pose)


def toy_table_over_can(rng: Rng) -> Situation:
    board = rng.uniform(0.122, 0.126), rng.uniform(0.084, 0.088)
    can = rng.uniform(0.013, 0.016), rng.uniform(0.014, 0.018)
    why = "no room beside the can, but over it"
    return _toy_table(rng, "toy_table_over_can", board, can, why, True)


def toy_table_over_high_can(rng: Rng) -> Situation:
    board = rng.uniform(0.110, 0.114), rng.uniform(0.0665, 0.0690)
    can = rng.uniform(0.018, 0.021), rng.uniform(0.069, 0.072)
    why = f"a can of {1e3 * can[1]:.0f} mm under a plate at 67 mm; lying it needs 70 mm, "
    why += f"of which the board has {1e3 * board[1]:.0f}"
    return _toy_table(rng, "toy_table_over_high_can", board, can, why, False)


def tray_over_can(rng: Rng) -> Situation:
    """Margins off, 27 mm are left beside the can, on which the tray does not stand on its end."""
    centre, top, radius = place(rng), 0.06, rng.uniform(0.0465, 0.0475)
    board = rng.uniform(0.1575, 0.159), rng.uniform(0.1175, 0.119)
    can = frustum("can", radius, radius, top, top + rng.uniform(0.016, 0.020), THING, centre)
    solids = (table(), standing_box("board", (*board, top), centre, 0.0, 0.0, DARK), can)
    scene = Scene("tray_over_can", slab(centre, (board[0] / 2, board[1] / 2), top), solids)
    why = "upside down it would stand over the can; held by its wall the hand is then below"
    pose = standing(centre, top, TRAY_UPSIDE_DOWN)
    return Situation("tray_over_can", "hollow things", "tray", scene, why, pose, robot_can=False)


def _mug(rng: Rng, name: str, gap: float, why: str, possible: bool) -> Situation:
    centre, height = place(rng), rng.uniform(0.045, 0.055)
    long = 0.14
    solids = [table()]
    for side in (-1.0, 1.0):
        at = (centre[0], centre[1] + side * (gap / 2 + 0.006))
        solids.append(standing_box(f"wall_{side:+.0f}", (long, 0.012, height), at, 0.0, 0.0, THING))
    scene = Scene(name, slab(centre, (long / 2 - 0.015, gap / 2), 0.0), tuple(solids))
    pose = standing((centre[0] - 0.025, centre[1]), yaw=np.pi) if possible else None
    return Situation(name, "hollow things", "mug", scene, why, pose)


def mug_between_walls(rng: Rng) -> Situation:
    gap = rng.uniform(0.096, 0.102)
    why = f"{1e3 * gap:.0f} mm between the walls: the handle must point along them"
    return _mug(rng, "mug_between_walls", gap, why, True)


def walls_too_near_for_mug(rng: Rng) -> Situation:
    gap = rng.uniform(0.0745, 0.078)
    why = f"{1e3 * gap:.1f} mm between the walls, the mug is 80 mm wide"
    return _mug(rng, "walls_too_near_for_mug", gap, why, False)


SITUATIONS = (
    bowl_over_frame, bowl_in_high_frame, toy_table_over_can, toy_table_over_high_can,
    tray_over_can, mug_between_walls, walls_too_near_for_mug,
)  # fmt: skip
