"""V of several boxes, and what one camera does not see of V."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.situations.situation import (
    BOX_ON_EDGE,
    SLAB,
    THING,
    Point,
    Situation,
    Unknown,
    place,
    slab,
    standing,
    table,
)
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.primitives import standing_box
from placement_planner_ros.scenes.scenes import Scene

Rng = np.random.Generator


def _squares(centres: Sequence[Point], side: float) -> TargetVolume:
    """V of squares around those places, on the table."""
    half = np.array([side / 2, side / 2, SLAB])
    places = np.column_stack([np.array(centres), np.zeros(len(centres))])
    return TargetVolume(places - half, places + half)


def two_halves(rng: Rng) -> Situation:
    """Boxes that abut: the object lies across."""
    centre = place(rng)
    half = rng.uniform(0.036, 0.042)
    volume = _squares([(centre[0] + x, centre[1]) for x in (-half, half)], 2 * half)
    why = "two boxes that abut, each too small alone"
    pose = standing(centre, rest=BOX_ON_EDGE)
    return Situation("two_halves", "several boxes", "large_crayons_box",
                     Scene("two_halves", volume, (table(),)), why, pose)  # fmt: skip


def two_squares(rng: Rng) -> Situation:
    """The centre of mass is over one, a corner of the object over the other."""
    centre, side = place(rng), rng.uniform(0.036, 0.041)
    corners = [(centre[0] + k * 0.072, centre[1] + k * 0.018) for k in (-1, 1)]
    volume = _squares([centre, *corners], side)
    why = "three squares apart: the middle over one, the corners over the others"
    pose = standing(centre, rest=BOX_ON_EDGE)
    return Situation("two_squares", "several boxes", "large_crayons_box",
                     Scene("two_squares", volume, (table(),)), why, pose)  # fmt: skip


def square_too_small(rng: Rng) -> Situation:
    centre, side = place(rng), rng.uniform(0.041, 0.044)
    volume = _squares([centre], side)
    long = 1e3 * np.sqrt(2.0) * side
    why = f"V is {long:.0f} mm across, and no corner is nearer to the middle than 65 mm"
    return Situation("square_too_small", "several boxes", "large_crayons_box",
                     Scene("square_too_small", volume, (table(),)), why)  # fmt: skip


def one_over_nothing(rng: Rng) -> Situation:
    """One box of V is over the table, the other beside it."""
    y = rng.uniform(-0.10, 0.10)
    on, beside = (0.40, y), (0.40, 0.58)
    volume = _squares([on, beside], rng.uniform(0.16, 0.18))
    pose = standing(on, rest=BOX_ON_EDGE)
    return Situation("one_over_nothing", "several boxes", "large_crayons_box",
                     Scene("one_over_nothing", volume, (table(),)),
                     "one box of V is over the table, the other beside it", pose)  # fmt: skip


def _screened(rng: Rng, name: str, x: tuple[float, float], height: float, why: str, seen: bool,
              unseen: str, unknown: Unknown = "occupied_below") -> Situation:  # fmt: skip
    """A screen between a low camera and V."""
    y = rng.uniform(-0.12, 0.12)
    screen = standing_box("screen", (0.010, 0.44, height), (0.36, y), 0.0, 0.0, THING)
    centre = (sum(x) / 2, y)
    volume = slab(centre, ((x[1] - x[0]) / 2, 0.15), 0.0)
    pose = standing(centre, rest=BOX_ON_EDGE, yaw=np.pi / 2)
    return Situation(name, "not seen", "large_crayons_box",
                     Scene(name, volume, (table(), screen)), why, pose, eye=(-0.05, y, 0.35),
                     seen=seen, unseen=unseen, unknown=unknown)  # fmt: skip


def behind_screen(rng: Rng) -> Situation:
    return _screened(rng, "behind_screen", (0.41, 0.53), rng.uniform(0.115, 0.125),
                     "free behind a screen", False, "the camera sees nothing of V")  # fmt: skip


def behind_low_screen(rng: Rng) -> Situation:
    return _screened(rng, "behind_low_screen", (0.41, 0.58), rng.uniform(0.045, 0.055),
                     "free behind a low screen", True, "")  # fmt: skip


def strip_behind_screen(rng: Rng) -> Situation:
    """The screen's shadow ends 8 to 13 mm before V does, in which the centre of mass must be."""
    height = rng.uniform(0.058, 0.066)
    end = 0.365 + 0.415 * height / (0.35 - height) + rng.uniform(0.008, 0.013)
    unseen = "of V the camera sees a strip of 13 mm at most, half of the box needs 18 mm"
    return _screened(rng, "strip_behind_screen", (0.38, end), height, "free behind a screen",
                     False, unseen)  # fmt: skip


def wide_open(rng: Rng) -> Situation:
    """What is not seen counts as free, as it does by default."""
    centre = place(rng)
    can = standing_box("can", (0.06, 0.06, 0.10), (centre[0] + 0.16, centre[1]), 0.3, 0.0, THING)
    scene = Scene("wide_open", slab(centre, (0.10, 0.10), 0.0), (table(), can))
    pose = standing(centre)
    return Situation("wide_open", "not seen", "mug", scene, "room on the table", pose,
                     unknown="free")  # fmt: skip


SITUATIONS = (
    two_halves, two_squares, square_too_small, one_over_nothing, behind_screen,
    behind_low_screen, strip_behind_screen, wide_open,
)  # fmt: skip
