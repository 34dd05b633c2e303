"""Tables off level, about both axes, up to the slope that is still support, and beyond it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin

from benchmarks.situations.situation import (
    BOX_ON_EDGE,
    SMALL_BOX,
    UPRIGHT,
    Draw,
    Limits,
    ObjectStance,
    Situation,
    SituationKind,
    slab_around,
    some_place,
    standing_pose,
    table_top,
)
from placement_planner_ros.core.types import upright

_HALF = 0.13
_ALLOWED = "{0:.1f}° off level, less than the 5° allowed"


def _on_slope(
    kind: SituationKind, degrees: Limits, azimuth: Limits | float, rng: np.random.Generator
) -> Situation:
    """A bare table that rises towards the azimuth (rad) by so many degrees."""
    towards = azimuth if isinstance(azimuth, float) else rng.uniform(*azimuth)
    angle = rng.uniform(*degrees)
    centre = some_place(rng)
    steep = np.tan(np.radians(angle))
    rotation = upright((float(steep * np.cos(towards)), float(steep * np.sin(towards))))
    pivot = np.array([*centre, 0.0])
    solid = table_top()
    solid = replace(solid, vertices=(solid.vertices - pivot) @ rotation.T + pivot)
    volume = slab_around(centre, (_HALF, _HALF), 0.0, 0.008 + 1.5 * _HALF * steep)
    witness = None
    if kind.stance is not None:
        upon = standing_pose((0.0, 0.0), stance=kind.stance, yaw=rng.uniform(-0.3, 0.3))
        witness = pin.SE3(rotation, pivot) * upon
    return replace(kind, why=kind.why.format(angle)).in_scene(volume, (solid,), witness)


def _allowed_slope(
    name: str, thing: str, degrees: Limits, azimuth: Limits | float, stance: ObjectStance
) -> Draw:
    kind = SituationKind(name, "tables", thing, _ALLOWED, stance)
    return partial(_on_slope, kind, degrees, azimuth)


_TOO_STEEP = SituationKind(
    "too_steep", "tables", "large_crayons_box", "{0:.1f}° off level, more than the 5° allowed"
)

SITUATIONS: tuple[Draw, ...] = (
    _allowed_slope("level_table", "drill", (0.0, 0.05), 0.0, UPRIGHT),
    _allowed_slope("tilted_1_about_y", "large_crayons_box", (0.8, 1.2), 0.0, BOX_ON_EDGE),
    _allowed_slope("tilted_2_about_x", "small_crayons_box", (1.7, 2.3), np.pi / 2, SMALL_BOX),
    _allowed_slope("tilted_3_about_both", "wine_glass", (2.7, 3.3), (0.4, 1.2), UPRIGHT),
    _allowed_slope("tilted_4_away", "toy_table", (3.6, 4.2), np.pi, UPRIGHT),
    _allowed_slope("tilted_5_about_both", "tray", (4.4, 4.8), (-2.5, -0.5), UPRIGHT),
    partial(_on_slope, _TOO_STEEP, (5.6, 6.5), (-np.pi, np.pi)),
)
