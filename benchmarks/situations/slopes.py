"""Tables off level, about both axes, up to the slope that is still support, and beyond it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from benchmarks.situations.situation import (
    BOX_ON_EDGE,
    SMALL_BOX,
    UPRIGHT,
    Point,
    Rest,
    Situation,
    place,
    slab,
    standing,
    table,
)
from placement_planner_ros.core.types import upright
from placement_planner_ros.scenes.scenes import Scene

Rng = np.random.Generator
_HALF = 0.13


def turned_table(centre: Point, degrees: float, azimuth: float) -> tuple[Scene, pin.SE3]:
    """A bare table that rises towards the azimuth (rad) by so much, and T_world_table."""
    steep = np.tan(np.radians(degrees))
    rotation = upright((float(steep * np.cos(azimuth)), float(steep * np.sin(azimuth))))
    pivot = np.array([*centre, 0.0])
    solid = table()
    solid = replace(solid, vertices=(solid.vertices - pivot) @ rotation.T + pivot)
    volume = slab(centre, (_HALF, _HALF), 0.0, 0.008 + 1.5 * _HALF * steep)
    return Scene("table", volume, (solid,)), pin.SE3(rotation, pivot)


def _tilted(rng: Rng, name: str, thing: str, degrees: tuple[float, float], azimuth: float,
            rest: Rest | None) -> Situation:  # fmt: skip
    steep = rng.uniform(*degrees)
    scene, T_world_table = turned_table(place(rng), steep, azimuth)
    allowed = "less than the 5° allowed" if rest is not None else "more than the 5° allowed"
    witness = None
    if rest is not None:
        witness = T_world_table * standing((0.0, 0.0), rest=rest, yaw=rng.uniform(-0.3, 0.3))
    why = f"{steep:.1f}° off level, {allowed}"
    return Situation(name, "tables", thing, replace(scene, name=name), why, witness)


def level_table(rng: Rng) -> Situation:
    return _tilted(rng, "level_table", "drill", (0.0, 0.05), 0.0, UPRIGHT)


def tilted_1_about_y(rng: Rng) -> Situation:
    return _tilted(rng, "tilted_1_about_y", "large_crayons_box", (0.8, 1.2), 0.0, BOX_ON_EDGE)


def tilted_2_about_x(rng: Rng) -> Situation:
    return _tilted(rng, "tilted_2_about_x", "small_crayons_box", (1.7, 2.3), np.pi / 2,
                   SMALL_BOX)  # fmt: skip


def tilted_3_about_both(rng: Rng) -> Situation:
    azimuth = rng.uniform(0.4, 1.2)
    return _tilted(rng, "tilted_3_about_both", "wine_glass", (2.7, 3.3), azimuth, UPRIGHT)


def tilted_4_away(rng: Rng) -> Situation:
    return _tilted(rng, "tilted_4_away", "toy_table", (3.6, 4.2), np.pi, UPRIGHT)


def tilted_5_about_both(rng: Rng) -> Situation:
    azimuth = rng.uniform(-2.5, -0.5)
    return _tilted(rng, "tilted_5_about_both", "tray", (4.4, 4.8), azimuth, UPRIGHT)


def too_steep(rng: Rng) -> Situation:
    azimuth = rng.uniform(-np.pi, np.pi)
    return _tilted(rng, "too_steep", "large_crayons_box", (5.6, 6.5), azimuth, None)


SITUATIONS = (
    level_table, tilted_1_about_y, tilted_2_about_x, tilted_3_about_both, tilted_4_away,
    tilted_5_about_both, too_steep,
)  # fmt: skip
