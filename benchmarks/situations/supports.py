"""Pedestals, bridges, racks, stacks and edges: is there enough to stand on?

What carries only a part of an object is no support where all corners must stand (`vertices`), and
may be where the centre of mass must lie within what carries (`polygon`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from benchmarks.situations.situation import (
    BOX_ON_EDGE,
    DARK,
    SMALL_BOX,
    THING,
    UPRIGHT,
    Draw,
    Limits,
    Point,
    Situation,
    SituationKind,
    slab_around,
    some_place,
)
from placement_planner_ros.scenes.primitives import ConvexPrimitive, box, frustum, standing_box

Rng = np.random.Generator
LARGE, SMALL = "large_crayons_box", "small_crayons_box"
_kind = SituationKind
_AROUND = 0.10
"""m that V reaches beyond a small support, for the corners that hang over."""


@dataclass(frozen=True, slots=True)
class SupportTop:
    """What is to carry, around a point at height z: half of its sides, and how the object is to be
    turned on it (rad)."""

    centre: Point
    half: Point
    z: float
    yaw: float = 0.0


def _on_top(
    kind: SituationKind, top: SupportTop, solids: list[ConvexPrimitive], spacing: float = 0.005
) -> Situation:
    volume = slab_around(top.centre, (top.half[0] + _AROUND, top.half[1] + _AROUND), top.z)
    return kind.drawn(volume, solids, top.centre, top.z, top.yaw, spacing=spacing)


def _a_block(centre: Point, size: tuple[float, float, float], yaw: float = 0.0) -> ConvexPrimitive:
    return standing_box("pedestal", size, centre, yaw, 0.0, THING)


def _on_pedestal(kind: SituationKind, height: float, *sides: Limits) -> Draw:
    """A block, square where one side is given."""

    def draw(rng: Rng) -> Situation:
        centre, drawn = some_place(rng), [rng.uniform(*side) for side in sides]
        long, wide = drawn[0], drawn[-1]
        top = SupportTop(centre, (long / 2, wide / 2), height)
        return _on_top(kind.sized(side=long), top, [_a_block(centre, (long, wide, height))])

    return draw


def _make_bars(centre: Point, offsets: np.ndarray, width: float, length: float, height: float,
          thick: float = 0.008) -> list[ConvexPrimitive]:  # fmt: skip
    """Bars along y at those x, their tops at `height`, on two beams."""
    made = [
        box(f"rack/bar_{k}", (centre[0] + x - width / 2, centre[1] - length / 2, height - thick),
            (centre[0] + x + width / 2, centre[1] + length / 2, height), DARK)
        for k, x in enumerate(offsets)
    ]  # fmt: skip
    low, high = offsets[0] - width / 2, offsets[-1] + width / 2
    for k, side in enumerate((-1.0, 1.0)):
        y = centre[1] + side * (length / 2 - 0.005)
        made.append(
            box(f"rack/beam_{k}", (centre[0] + low, y - 0.005, 0.0),
                (centre[0] + high, y + 0.005, height - thick), THING)
        )  # fmt: skip
    return made


def box_on_bridge(rng: Rng) -> Situation:
    centre, width = some_place(rng), rng.uniform(0.034, 0.038)
    solids = _make_bars(centre, np.array([-0.065, 0.065]), width, 0.20, 0.09)
    kind = _kind("box_on_bridge", "bridges", LARGE, "one end on each bar", BOX_ON_EDGE)
    return _on_top(kind, SupportTop(centre, (0.08, 0.10), 0.09), solids)


def _inner_bridge(kind: SituationKind, rng: Rng) -> Situation:
    centre, width = some_place(rng), rng.uniform(0.019, 0.022)
    apart = rng.uniform(0.060, 0.070)
    solids = _make_bars(centre, np.array([-apart / 2, apart / 2]), width, 0.20, 0.09)
    top = SupportTop(centre, (0.05, 0.10), 0.09)
    return _on_top(kind.sized(apart=apart, width=width), top, solids)


def _on_plank(kind: SituationKind, widths: Limits, rng: Rng) -> Situation:
    width, centre = rng.uniform(*widths), some_place(rng)
    top = SupportTop(centre, (width / 2, 0.12), 0.09, np.pi / 2)
    return _on_top(
        kind.sized(width=width), top, _make_bars(centre, np.array([0.0]), width, 0.24, 0.09)
    )


def _on_rack(
    kind: SituationKind, pitches: Limits, widths: Limits | float, shift: float, rng: Rng
) -> Situation:
    """Bars all along 240 mm; one is at `shift` pitches from the middle."""
    pitch = rng.uniform(*pitches)
    width = widths if isinstance(widths, float) else rng.uniform(*widths)
    centre, count = some_place(rng), max(1, int(0.11 / pitch))
    offsets = shift * pitch + pitch * np.arange(-count, count + 1)
    half = (max(abs(offsets[0]), abs(offsets[-1])) + width / 2 - _AROUND, 0.11 - _AROUND)
    solids = _make_bars(centre, offsets, width, 0.22, 0.06)
    top, spacing = SupportTop(centre, half, 0.06), 0.0025 if width < 0.01 else 0.004
    return _on_top(kind.sized(pitch=pitch), top, solids, spacing)


def _on_grating(kind: SituationKind, pitches: Limits) -> Draw:
    return partial(_on_rack, kind, pitches, 0.005, 0.0)


_THIN = "bars of 5 mm, the edge margin of 3 mm on either side leaves nothing of them"


def toy_table_on_mesh(rng: Rng) -> Situation:
    """Wires both ways; the complete cloud shows two rows on each, 5 mm apart along it."""
    (x, y), pitch, width = some_place(rng), rng.uniform(0.0125, 0.0145), rng.uniform(0.0024, 0.003)
    z = rng.uniform(0.05, 0.07)
    offsets = pitch * np.arange(-8, 9)
    end = offsets[-1] + width / 2
    solids = [
        standing_box("mesh/wire", (2 * end, width, width), at, yaw, z - width, THING)
        for offset in offsets
        for at, yaw in (((x, y + offset), 0.0), ((x + offset, y), np.pi / 2))
    ] + [
        standing_box("mesh/post", (width, width, z - width), (x + i, y + j), 0.0, 0.0, THING)
        for i in (-offsets[-1], offsets[-1])
        for j in (-offsets[-1], offsets[-1])
    ]
    why = "wires of {width:.1f} mm, the edge margin of 3 mm leaves nothing of them"
    kind = _kind("toy_table_on_mesh", "racks", "toy_table", why).sized(width=width)
    return _on_top(kind, SupportTop((x, y), (end - _AROUND,) * 2, z), solids)


def _on_can(kind: SituationKind, radii: Limits, heights: Limits | float, rng: Rng) -> Situation:
    """On a can or bottle."""
    radius = rng.uniform(*radii)
    height = heights if isinstance(heights, float) else rng.uniform(*heights)
    centre = some_place(rng)
    solid = frustum("can", (radius, radius), (0.0, height), THING, centre)
    top = SupportTop(centre, (radius, radius), height)
    return _on_top(kind.sized(width=2 * radius), top, [solid])


def box_on_box(rng: Rng) -> Situation:
    centre = some_place(rng)
    size = (rng.uniform(0.13, 0.14), rng.uniform(0.048, 0.054), rng.uniform(0.07, 0.10))
    yaw = rng.uniform(-0.6, 0.6)
    kind = _kind("box_on_box", "stacks", SMALL, "the lower box is wider", SMALL_BOX)
    return _on_top(
        kind, SupportTop(centre, (0.06, 0.06), size[2], yaw), [_a_block(centre, size, yaw)]
    )


def _on_ledge(kind: SituationKind, rng: Rng) -> Situation:
    centre, depth = some_place(rng), rng.uniform(0.058, 0.062)
    solid = standing_box("ledge", (depth, 0.30, 0.09), centre, 0.0, 0.0, THING)
    return _on_top(kind.sized(depth=depth), SupportTop(centre, (depth / 2, 0.05), 0.09), [solid])


def _at_step(kind: SituationKind, halves: Limits, rng: Rng) -> Situation:
    """V on either side of a step."""
    half, (x, y), rise = rng.uniform(*halves), some_place(rng), rng.uniform(0.005, 0.008)
    upper = box("step", (x, y - 0.18, 0.0), (x + 0.18, y + 0.18, rise), THING)
    volume = slab_around((x, y), (half, 0.16), rise / 2, 0.5 * rise + 0.004)
    return kind.sized(half=half).drawn(volume, [upper], (x - half / 2, y), yaw=np.pi / 2)


_BRIDGE = "bars {apart:.0f} mm apart, {width:.0f} mm wide: "
_SMALL_CAN, _CAN_HEIGHTS = (0.024, 0.027), (0.07, 0.10)
_LEDGE = "a ledge {depth:.0f} mm deep, 0.3 m long, under a foot 64 mm wide: "

SITUATIONS: tuple[Draw, ...] = (
    _on_pedestal(
        _kind("box_on_pedestal", "pedestals", LARGE, "all four corners on it", BOX_ON_EDGE),
        0.10, (0.18, 0.20), (0.066, 0.076),
    ),
    _on_pedestal(
        _kind("small_pedestal", "pedestals", LARGE,
              "{side:.0f} mm square under a side of 144 × 36 mm: corners hang over"),
        0.10, (0.060, 0.080),
    ),
    _on_pedestal(
        _kind("small_pedestal_polygon", "pedestals", LARGE,
              "{side:.0f} mm square, the middle of the box well within", BOX_ON_EDGE, "polygon"),
        0.10, (0.060, 0.080),
    ),
    _on_pedestal(
        _kind("post_polygon", "pedestals", LARGE,
              "a post {side:.0f} mm square: the margin of 10 mm leaves nothing of it", None,
              "polygon"),
        0.10, (0.013, 0.017),
    ),
    box_on_bridge,
    partial(_inner_bridge,
            _kind("inner_bridge", "bridges", LARGE, f"{_BRIDGE}the ends hang over")),
    partial(_inner_bridge,
            _kind("inner_bridge_polygon", "bridges", LARGE,
                  f"{_BRIDGE}the middle is well between them", BOX_ON_EDGE, "polygon")),
    partial(_on_plank, _kind("plank", "bridges", LARGE, "a plank wider than the box", BOX_ON_EDGE),
            (0.062, 0.068)),
    partial(_on_plank,
            _kind("plank_too_narrow", "bridges", LARGE,
                  "a plank of {width:.0f} mm under a box of 36 mm"), (0.031, 0.034)),
    partial(_on_plank,
            _kind("plank_polygon", "bridges", LARGE,
                  "a plank of {width:.0f} mm, the middle more than 10 mm within", BOX_ON_EDGE,
                  "polygon"), (0.029, 0.033)),
    partial(_on_plank,
            _kind("lath_polygon", "bridges", LARGE,
                  "a lath of {width:.0f} mm: the margin of 10 mm leaves nothing of it", None,
                  "polygon"), (0.014, 0.018)),
    partial(_on_rack,
            _kind("box_on_slats", "racks", LARGE, "three slats apart are the ends of the box",
                  BOX_ON_EDGE), (0.0475, 0.0485), (0.030, 0.032), 0.5),
    partial(_on_rack,
            _kind("toy_table_on_slats", "racks", "toy_table",
                  "two slats apart are the legs of the toy table", UPRIGHT),
            (0.0505, 0.0515), (0.030, 0.033), 0.0),
    _on_grating(_kind("toy_table_on_grating_15", "racks", "toy_table", _THIN), (0.0148, 0.0152)),
    _on_grating(_kind("toy_table_on_grating_20", "racks", "toy_table", _THIN), (0.0198, 0.0202)),
    toy_table_on_mesh,
    _on_grating(_kind("glass_on_grating", "racks", "wine_glass", _THIN), (0.0168, 0.0182)),
    _on_grating(_kind("box_on_grating_polygon", "racks", LARGE,
                   "the middle of the box is between bars that carry it from end to end",
                   BOX_ON_EDGE, "polygon"), (0.0180, 0.0200)),
    _on_grating(_kind("glass_on_grating_polygon", "racks", "wine_glass",
                   "three bars under the foot, the middle between them", UPRIGHT, "polygon"),
             (0.0168, 0.0182)),
    _on_grating(_kind("toy_table_on_wide_grating_polygon", "racks", "toy_table",
                   "bars {pitch:.0f} mm apart, the toy table is 132 mm long on any side, "
                   "diagonally", None, "polygon"), (0.136, 0.140)),
    partial(_on_can, _kind("glass_on_can", "stacks", "wine_glass",
                        "the can is wider than the foot", UPRIGHT),
            (0.042, 0.046), _CAN_HEIGHTS),
    partial(_on_can, _kind("glass_on_small_can", "stacks", "wine_glass",
                        "a can {width:.0f} mm wide under a foot of 57 mm"),
            _SMALL_CAN, _CAN_HEIGHTS),
    partial(_on_can, _kind("glass_on_small_can_polygon", "stacks", "wine_glass",
                        "the middle of the glass is above the can, more than 10 mm within",
                        UPRIGHT, "polygon"), _SMALL_CAN, _CAN_HEIGHTS),
    partial(_on_can, _kind("box_on_bottle", "stacks", SMALL,
                        "a neck of {width:.0f} mm under a box 21 mm wide: corners hang over"),
            (0.007, 0.009), 0.12),
    box_on_box,
    _on_pedestal(
        _kind("tray_on_box_polygon", "stacks", "tray",
              "the middle of the tray is well within the box, its ends hang over", UPRIGHT,
              "polygon"),
        0.08, (0.11, 0.13), (0.11, 0.13),
    ),
    partial(_on_ledge, _kind("bowl_on_ledge", "ledges", "bowl", f"{_LEDGE}some of it hangs over")),
    partial(_on_ledge, _kind("bowl_on_ledge_polygon", "ledges", "bowl",
                          f"{_LEDGE}the middle is well within", UPRIGHT, "polygon")),
    partial(_at_step, _kind("on_step", "steps", LARGE, "V ends {half:.0f} mm on either side of a "
                         "step; the box needs 18 mm on one"), (0.006, 0.009)),
    partial(_at_step, _kind("beside_step", "steps", LARGE, "room on either side of the step",
                         BOX_ON_EDGE), (0.050, 0.060)),
)  # fmt: skip
