"""Pedestals, bridges, racks, stacks and edges: is there enough to stand on?

What carries only a part of an object is no support where all corners must stand (`vertices`), and
may be where the centre of mass must lie within what carries (`polygon`).
"""

from __future__ import annotations

import numpy as np

from benchmarks.situations.situation import (
    BOX_ON_EDGE,
    DARK,
    SMALL_BOX,
    THING,
    UPRIGHT,
    Point,
    Rest,
    Situation,
    Support,
    place,
    slab,
    standing,
    table,
)
from placement_planner_ros.scenes.primitives import ConvexPrimitive, box, frustum, standing_box
from placement_planner_ros.scenes.scenes import Scene

Rng = np.random.Generator
_AROUND = 0.10
"""m that V reaches beyond a small support, for the corners that hang over."""


def _on(
    name: str,
    group: str,
    thing: str,
    solids: list[ConvexPrimitive],
    half: Point,
    centre: Point,
    z: float,
    why: str,
    rest: Rest | None,
    support: Support = "vertices",
    yaw: float = 0.0,
    spacing: float = 0.005,
) -> Situation:
    volume = slab(centre, (half[0] + _AROUND, half[1] + _AROUND), z)
    witness = None if rest is None else standing(centre, z, rest, yaw)
    scene = Scene(name, volume, (table(), *solids))
    return Situation(name, group, thing, scene, why, witness, support=support, spacing=spacing)


def _block(centre: Point, size: tuple[float, float, float], yaw: float = 0.0) -> ConvexPrimitive:
    return standing_box("pedestal", size, centre, yaw, 0.0, THING)


def box_on_pedestal(rng: Rng) -> Situation:
    centre, size = place(rng), (rng.uniform(0.18, 0.20), rng.uniform(0.066, 0.076), 0.10)
    why = "all four corners on it"
    return _on("box_on_pedestal", "pedestals", "large_crayons_box", [_block(centre, size)],
               (size[0] / 2, size[1] / 2), centre, size[2], why, BOX_ON_EDGE)  # fmt: skip


def _small_pedestal(rng: Rng, name: str, support: Support) -> Situation:
    centre, side = place(rng), rng.uniform(0.060, 0.080)
    why = (
        f"{1e3 * side:.0f} mm square under a side of 144 × 36 mm: corners hang over"
        if support == "vertices"
        else f"{1e3 * side:.0f} mm square, the middle of the box well within"
    )
    rest = None if support == "vertices" else BOX_ON_EDGE
    return _on(name, "pedestals", "large_crayons_box", [_block(centre, (side, side, 0.10))],
               (side / 2, side / 2), centre, 0.10, why, rest, support)  # fmt: skip


def small_pedestal(rng: Rng) -> Situation:
    return _small_pedestal(rng, "small_pedestal", "vertices")


def small_pedestal_polygon(rng: Rng) -> Situation:
    return _small_pedestal(rng, "small_pedestal_polygon", "polygon")


def post_polygon(rng: Rng) -> Situation:
    centre, side = place(rng), rng.uniform(0.013, 0.017)
    why = f"a post {1e3 * side:.0f} mm square: the margin of 10 mm leaves nothing of it"
    return _on("post_polygon", "pedestals", "large_crayons_box",
               [_block(centre, (side, side, 0.10))], (side / 2, side / 2), centre, 0.10, why,
               None, "polygon")  # fmt: skip


def _bars(centre: Point, offsets: np.ndarray, width: float, length: float, height: float,
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
    centre, width = place(rng), rng.uniform(0.034, 0.038)
    offsets = np.array([-0.065, 0.065])
    why = "one end on each bar"
    return _on("box_on_bridge", "bridges", "large_crayons_box",
               _bars(centre, offsets, width, 0.20, 0.09), (0.08, 0.10), centre, 0.09, why,
               BOX_ON_EDGE)  # fmt: skip


def _inner_bridge(rng: Rng, name: str, support: Support) -> Situation:
    centre, width = place(rng), rng.uniform(0.019, 0.022)
    apart = rng.uniform(0.060, 0.070)
    why = f"bars {1e3 * apart:.0f} mm apart, {1e3 * width:.0f} mm wide: "
    why += "the ends hang over" if support == "vertices" else "the middle is well between them"
    rest = None if support == "vertices" else BOX_ON_EDGE
    return _on(name, "bridges", "large_crayons_box",
               _bars(centre, np.array([-apart / 2, apart / 2]), width, 0.20, 0.09),
               (0.05, 0.10), centre, 0.09, why, rest, support)  # fmt: skip


def inner_bridge(rng: Rng) -> Situation:
    return _inner_bridge(rng, "inner_bridge", "vertices")


def inner_bridge_polygon(rng: Rng) -> Situation:
    return _inner_bridge(rng, "inner_bridge_polygon", "polygon")


def _plank(rng: Rng, name: str, width: float, support: Support, rest: Rest | None,
           why: str) -> Situation:  # fmt: skip
    centre = place(rng)
    solids = _bars(centre, np.array([0.0]), width, 0.24, 0.09)
    return _on(name, "bridges", "large_crayons_box", solids, (width / 2, 0.12), centre, 0.09, why,
               rest, support, np.pi / 2)  # fmt: skip


def plank_too_narrow(rng: Rng) -> Situation:
    width = rng.uniform(0.031, 0.034)
    why = f"a plank of {1e3 * width:.0f} mm under a box of 36 mm"
    return _plank(rng, "plank_too_narrow", width, "vertices", None, why)


def plank_polygon(rng: Rng) -> Situation:
    width = rng.uniform(0.029, 0.033)
    why = f"a plank of {1e3 * width:.0f} mm, the middle more than 10 mm within"
    return _plank(rng, "plank_polygon", width, "polygon", BOX_ON_EDGE, why)


def lath_polygon(rng: Rng) -> Situation:
    width = rng.uniform(0.014, 0.018)
    why = f"a lath of {1e3 * width:.0f} mm: the margin of 10 mm leaves nothing of it"
    return _plank(rng, "lath_polygon", width, "polygon", None, why)


def plank(rng: Rng) -> Situation:
    width = rng.uniform(0.062, 0.068)
    why = "a plank wider than the box"
    return _plank(rng, "plank", width, "vertices", BOX_ON_EDGE, why)


def _rack(
    rng: Rng, name: str, thing: str, pitch: float, width: float, why: str, rest: Rest | None,
    support: Support = "vertices", shift: float = 0.0, yaw: float = 0.0,
) -> Situation:  # fmt: skip
    """Bars all along 240 mm; one is at `shift` from the middle."""
    centre = place(rng)
    count = max(1, int(0.11 / pitch))
    offsets = shift + pitch * np.arange(-count, count + 1)
    solids = _bars(centre, offsets, width, 0.22, 0.06)
    half = (max(abs(offsets[0]), abs(offsets[-1])) + width / 2 - _AROUND, 0.11 - _AROUND)
    return _on(name, "racks", thing, solids, half, centre, 0.06, why, rest, support, yaw,
               0.0025 if width < 0.01 else 0.004)  # fmt: skip


def box_on_slats(rng: Rng) -> Situation:
    pitch, width = rng.uniform(0.0475, 0.0485), rng.uniform(0.030, 0.032)
    why = "three slats apart are the ends of the box"
    return _rack(rng, "box_on_slats", "large_crayons_box", pitch, width, why, BOX_ON_EDGE,
                 shift=pitch / 2)  # fmt: skip


def toy_table_on_slats(rng: Rng) -> Situation:
    pitch, width = rng.uniform(0.0505, 0.0515), rng.uniform(0.030, 0.033)
    why = "two slats apart are the legs of the toy table"
    return _rack(rng, "toy_table_on_slats", "toy_table", pitch, width, why, UPRIGHT)


def _grating(rng: Rng, name: str, thing: str, support: Support, rest: Rest | None, why: str,
             pitch: float, shift: float = 0.0, yaw: float = 0.0) -> Situation:  # fmt: skip
    return _rack(rng, name, thing, pitch, 0.005, why, rest, support, shift, yaw)


_THIN = "bars of 5 mm, the edge margin of 3 mm on either side leaves nothing of them"


def toy_table_on_grating_15(rng: Rng) -> Situation:
    return _grating(rng, "toy_table_on_grating_15", "toy_table", "vertices", None, _THIN,
                    rng.uniform(0.0148, 0.0152))  # fmt: skip


def toy_table_on_grating_20(rng: Rng) -> Situation:
    return _grating(rng, "toy_table_on_grating_20", "toy_table", "vertices", None, _THIN,
                    rng.uniform(0.0198, 0.0202))  # fmt: skip


def glass_on_grating(rng: Rng) -> Situation:
    return _grating(rng, "glass_on_grating", "wine_glass", "vertices", None, _THIN,
                    rng.uniform(0.0168, 0.0182))  # fmt: skip


def box_on_grating_polygon(rng: Rng) -> Situation:
    why = "the middle of the box is between bars that carry it from end to end"
    return _grating(rng, "box_on_grating_polygon", "large_crayons_box", "polygon", BOX_ON_EDGE,
                    why, rng.uniform(0.0180, 0.0200))  # fmt: skip


def glass_on_grating_polygon(rng: Rng) -> Situation:
    why = "three bars under the foot, the middle between them"
    return _grating(rng, "glass_on_grating_polygon", "wine_glass", "polygon", UPRIGHT, why,
                    rng.uniform(0.0168, 0.0182))  # fmt: skip


def toy_table_on_wide_grating_polygon(rng: Rng) -> Situation:
    pitch = rng.uniform(0.136, 0.140)
    why = f"bars {1e3 * pitch:.0f} mm apart, the toy table is 132 mm long on any side, diagonally"
    return _grating(
        rng, "toy_table_on_wide_grating_polygon", "toy_table", "polygon", None, why, pitch
    )


def toy_table_on_mesh(rng: Rng) -> Situation:
    """Wires both ways; the complete cloud shows two rows on each, 5 mm apart along it."""
    (x, y), pitch, width = place(rng), rng.uniform(0.0125, 0.0145), rng.uniform(0.0024, 0.003)
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
    why = f"wires of {1e3 * width:.1f} mm, the edge margin of 3 mm leaves nothing of them"
    return _on("toy_table_on_mesh", "racks", "toy_table", solids, (end - _AROUND,) * 2, (x, y),
               z, why, None)  # fmt: skip


def _top(rng: Rng, name: str, thing: str, radius: float, height: float, why: str,
         rest: Rest | None, support: Support = "vertices") -> Situation:  # fmt: skip
    """On a can or bottle."""
    centre = place(rng)
    solid = frustum("can", radius, radius, 0.0, height, THING, centre)
    return _on(name, "stacks", thing, [solid], (radius, radius), centre, height, why, rest,
               support)  # fmt: skip


def glass_on_can(rng: Rng) -> Situation:
    radius = rng.uniform(0.042, 0.046)
    why = "the can is wider than the foot"
    return _top(rng, "glass_on_can", "wine_glass", radius, rng.uniform(0.07, 0.10), why, UPRIGHT)


def glass_on_small_can(rng: Rng) -> Situation:
    radius = rng.uniform(0.024, 0.027)
    why = f"a can {2e3 * radius:.0f} mm wide under a foot of 57 mm"
    return _top(rng, "glass_on_small_can", "wine_glass", radius, rng.uniform(0.07, 0.10), why,
                None)  # fmt: skip


def glass_on_small_can_polygon(rng: Rng) -> Situation:
    radius = rng.uniform(0.024, 0.027)
    why = "the middle of the glass is above the can, more than 10 mm within"
    return _top(rng, "glass_on_small_can_polygon", "wine_glass", radius, rng.uniform(0.07, 0.10),
                why, UPRIGHT, "polygon")  # fmt: skip


def box_on_bottle(rng: Rng) -> Situation:
    radius = rng.uniform(0.007, 0.009)
    why = f"a neck of {2e3 * radius:.0f} mm under a box 21 mm wide: corners hang over"
    return _top(rng, "box_on_bottle", "small_crayons_box", radius, 0.12, why, None)


def box_on_box(rng: Rng) -> Situation:
    centre = place(rng)
    size = (rng.uniform(0.13, 0.14), rng.uniform(0.048, 0.054), rng.uniform(0.07, 0.10))
    yaw = rng.uniform(-0.6, 0.6)
    why = "the lower box is wider"
    return _on("box_on_box", "stacks", "small_crayons_box", [_block(centre, size, yaw)],
               (0.06, 0.06), centre, size[2], why, SMALL_BOX, yaw=yaw)  # fmt: skip


def tray_on_box(rng: Rng) -> Situation:
    """All but the tray's ends."""
    centre = place(rng)
    size = (rng.uniform(0.11, 0.13), rng.uniform(0.11, 0.13), 0.08)
    why = "the middle of the tray is well within the box, its ends hang over"
    return _on("tray_on_box_polygon", "stacks", "tray", [_block(centre, size)],
               (size[0] / 2, size[1] / 2), centre, size[2], why, UPRIGHT, "polygon")  # fmt: skip


def _ledge(rng: Rng, name: str, support: Support) -> Situation:
    centre, depth = place(rng), rng.uniform(0.058, 0.062)
    why = f"a ledge {1e3 * depth:.0f} mm deep, 0.3 m long, under a foot 64 mm wide: "
    why += "some of it hangs over" if support == "vertices" else "the middle is well within"
    rest = None if support == "vertices" else UPRIGHT
    solid = standing_box("ledge", (depth, 0.30, 0.09), centre, 0.0, 0.0, THING)
    return _on(name, "ledges", "bowl", [solid], (depth / 2, 0.05), centre, 0.09, why, rest,
               support)  # fmt: skip


def ledge(rng: Rng) -> Situation:
    return _ledge(rng, "bowl_on_ledge", "vertices")


def ledge_polygon(rng: Rng) -> Situation:
    return _ledge(rng, "bowl_on_ledge_polygon", "polygon")


def _step(rng: Rng, name: str, half: float, why: str, possible: bool) -> Situation:
    centre, rise = place(rng), rng.uniform(0.005, 0.008)
    upper = box("step", (centre[0], centre[1] - 0.18, 0.0),
                (centre[0] + 0.18, centre[1] + 0.18, rise), THING)  # fmt: skip
    volume = slab(centre, (half, 0.16), rise / 2, 0.5 * rise + 0.004)
    witness = None
    if possible:
        witness = standing((centre[0] - half / 2, centre[1]), rest=BOX_ON_EDGE, yaw=np.pi / 2)
    scene = Scene(name, volume, (table(), upper))
    return Situation(name, "steps", "large_crayons_box", scene, why, witness)


def on_step(rng: Rng) -> Situation:
    half = rng.uniform(0.006, 0.009)
    why = f"V ends {1e3 * half:.0f} mm on either side of a step; the box needs 18 mm on one"
    return _step(rng, "on_step", half, why, False)


def beside_step(rng: Rng) -> Situation:
    half = rng.uniform(0.050, 0.060)
    return _step(rng, "beside_step", half, "room on either side of the step", True)


SITUATIONS = (
    box_on_pedestal, small_pedestal, small_pedestal_polygon, post_polygon, box_on_bridge,
    inner_bridge, inner_bridge_polygon, plank, plank_too_narrow, plank_polygon, lath_polygon,
    box_on_slats, toy_table_on_slats, toy_table_on_grating_15, toy_table_on_grating_20,
    toy_table_on_mesh, glass_on_grating, box_on_grating_polygon, glass_on_grating_polygon,
    toy_table_on_wide_grating_polygon, glass_on_can, glass_on_small_can,
    glass_on_small_can_polygon, box_on_bottle, box_on_box, tray_on_box, ledge, ledge_polygon,
    on_step, beside_step,
)  # fmt: skip
