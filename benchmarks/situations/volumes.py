"""V of several boxes, and what one camera does not see of V."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.situations.situation import (
    BOX_ON_EDGE,
    SLAB,
    THING,
    UPRIGHT,
    Draw,
    ObjectStance,
    Point,
    Situation,
    SituationKind,
    slab_around,
    some_place,
)
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.primitives import standing_box

Rng = np.random.Generator


def _square_volume(centres: Sequence[Point], side: float) -> TargetVolume:
    """V of squares around those places, on the table."""
    half = np.array([side / 2, side / 2, SLAB])
    places = np.column_stack([np.array(centres), np.zeros(len(centres))])
    return TargetVolume(places - half, places + half)


def _parted_kind(name: str, why: str, stance: ObjectStance | None = BOX_ON_EDGE) -> SituationKind:
    return SituationKind(name, "several boxes", "large_crayons_box", why, stance)


def two_halves(rng: Rng) -> Situation:
    """Boxes that abut: the object lies across."""
    (x, y), half = some_place(rng), rng.uniform(0.036, 0.042)
    volume = _square_volume([(x - half, y), (x + half, y)], 2 * half)
    kind = _parted_kind("two_halves", "two boxes that abut, each too small alone")
    return kind.drawn(volume, (), (x, y))


def two_squares(rng: Rng) -> Situation:
    """The centre of mass is over one, a corner of the object over the other."""
    (x, y), side = some_place(rng), rng.uniform(0.036, 0.041)
    volume = _square_volume([(x, y), (x - 0.072, y - 0.018), (x + 0.072, y + 0.018)], side)
    why = "three squares apart: the middle over one, the corners over the others"
    return _parted_kind("two_squares", why).drawn(volume, (), (x, y))


def square_too_small(rng: Rng) -> Situation:
    centre, side = some_place(rng), rng.uniform(0.041, 0.044)
    why = "V is {long:.0f} mm across, and no corner is nearer to the middle than 65 mm"
    kind = _parted_kind("square_too_small", why, None).sized(long=np.sqrt(2.0) * side)
    return kind.drawn(_square_volume([centre], side), (), centre)


def one_over_nothing(rng: Rng) -> Situation:
    """One box of V is over the table, the other beside it."""
    y = rng.uniform(-0.10, 0.10)
    volume = _square_volume([(0.40, y), (0.40, 0.58)], rng.uniform(0.16, 0.18))
    kind = _parted_kind("one_over_nothing", "one box of V is over the table, the other beside it")
    return kind.drawn(volume, (), (0.40, y))


def _behind_screen(
    name: str, why: str, ends: tuple[float, float], height: float, unseen: str, rng: Rng
) -> Situation:
    """A screen between a low camera and V, which is between two ends along x.

    Args:
        unseen: why the camera does not see enough of V; '' where it does.
    """
    y = rng.uniform(-0.12, 0.12)
    screen = standing_box("screen", (0.010, 0.44, height), (0.36, y), 0.0, 0.0, THING)
    centre = (sum(ends) / 2, y)
    volume = slab_around(centre, ((ends[1] - ends[0]) / 2, 0.15), 0.0)
    kind = SituationKind(name, "not seen", "large_crayons_box", why, BOX_ON_EDGE)
    eye = (-0.05, y, 0.35)
    return kind.drawn(
        volume, (screen,), centre, yaw=np.pi / 2, eye=eye, seen=not unseen, unseen=unseen
    )


def behind_screen(rng: Rng) -> Situation:
    return _behind_screen("behind_screen", "free behind a screen", (0.41, 0.53),
                     rng.uniform(0.115, 0.125), "the camera sees nothing of V", rng)  # fmt: skip


def behind_low_screen(rng: Rng) -> Situation:
    return _behind_screen("behind_low_screen", "free behind a low screen", (0.41, 0.58),
                     rng.uniform(0.045, 0.055), "", rng)  # fmt: skip


def strip_behind_screen(rng: Rng) -> Situation:
    """The screen's shadow ends 8 to 13 mm before V does, in which the centre of mass must be."""
    height = rng.uniform(0.058, 0.066)
    end = 0.365 + 0.415 * height / (0.35 - height) + rng.uniform(0.008, 0.013)
    unseen = "of V the camera sees a strip of 13 mm at most, half of the box needs 18 mm"
    why = "free behind a screen"
    return _behind_screen("strip_behind_screen", why, (0.38, end), height, unseen, rng)


def wide_open(rng: Rng) -> Situation:
    """What is not seen counts as free, as it does by default."""
    x, y = some_place(rng)
    can = standing_box("can", (0.06, 0.06, 0.10), (x + 0.16, y), 0.3, 0.0, THING)
    kind = SituationKind("wide_open", "not seen", "mug", "room on the table", UPRIGHT)
    return kind.drawn(slab_around((x, y), (0.10, 0.10), 0.0), (can,), (x, y), unknown="free")


SITUATIONS: tuple[Draw, ...] = (
    two_halves, two_squares, square_too_small, one_over_nothing, behind_screen,
    behind_low_screen, strip_behind_screen, wide_open,
)  # fmt: skip
