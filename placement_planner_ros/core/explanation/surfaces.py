"""Placement regions in words: which there are, or what of V is why there are none."""

from __future__ import annotations

import math

import numpy as np

from placement_planner_ros.core.explanation.explanation import SENSOR, Explanation, Remedy
from placement_planner_ros.core.scene.environment import CONTACT_TOLERANCE_M, Environment
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.settings import meaning_of
from placement_planner_ros.core.types import Array, steepness

_ARM_SPAN_M = 50.0
"""Points farther away are perhaps in another unit."""
_LEVEL_AREA_M2 = 0.0025
"""Of surface at one level that is worth naming."""

_HEAD = "no placement region"
_ALIGN = Remedy(SENSOR, "correct the pose of the sensor, if the points are not where it is")


def why_no_region(environment: Environment) -> Explanation:
    """The first of these that holds: no points, none in reach, steep, above or below V, beside V,
    V too narrow; else what a region needs."""
    volume, measured = environment.volume, environment.measured
    if environment.points == 0:
        own = environment.near.left_out
        given = Remedy("environment", "give points of the surroundings")
        if not own:
            return Explanation(f"{_HEAD}: the cloud is empty", (given,))
        leave = Remedy("own points", "leave out no more than the robot and what it holds")
        words = f"all {own:,} points of the clouds are taken for those of the robot or the object"
        return Explanation(f"{_HEAD}: {words}", (given, leave))
    span = f"the {environment.points:,} points span {_box_in_words(environment.extent)}"
    of_volume = _box_in_words(np.stack([volume.lower, volume.upper]))
    # there are points, but all lie outside of the workspace
    if len(measured) == 0:
        far = bool(np.abs(environment.extent).max() > _ARM_SPAN_M)
        in_metres = Remedy("environment", "give points in metres, not in millimetres")
        return Explanation(
            f"{_HEAD}: no point of the clouds lies where the robot could reach: {span}"
            f"{'; they are taken to be metres' if far else ''}; `volume` is {of_volume}",
            (
                *((in_metres,) if far else ()),
                Remedy(SENSOR, "give the pose of the sensor's frame, in metres"),
                Remedy("root frame", "name the one that `volume` is meant in"),
            ),
        )
    return too_steep(environment) or _beside_volume(environment, span, of_volume)


def too_steep(environment: Environment) -> Explanation | None:
    """That the largest surface in V is steeper than `max_slope`; None where it is not."""
    steep = [plane for plane in environment.steep if environment.volume.contains(plane.middle)]
    if not steep:
        return None
    # the first plane is the largest
    rise, allowed = np.array(steep[0].slope), environment.max_slope
    span = f"the {environment.points:,} points span {_box_in_words(environment.extent)}"
    slope = steepness(rise)
    x, y = rise / np.hypot(*rise)
    by = f"{math.degrees(slope):.1f} degrees"
    remedies = [
        Remedy(SENSOR, f"correct the sensor's tilt by {by}, if the surface is level in truth"),
        Remedy("volume", "choose one with a level surface, if it is not"),
    ]
    # only where the parameter may be set that high
    if slope <= meaning_of(RegionSettings(), "max_slope").ends[1]:
        # half as much friction again as the slope takes
        to, friction = math.ceil(1e3 * slope) / 1e3, 1.5 * math.tan(slope)
        words = f"raise it to {to:.3f}, if friction there is {friction:.2f} or more"
        # what slopes by more than objects are put down on unasked is a sensor's fault first
        first = 1 if slope > RegionSettings().max_slope else 0
        remedies.insert(first, Remedy("max_slope", words))
    return Explanation(
        f"{_HEAD}: the largest surface in `volume` slopes by {by}, rising "
        f"towards x = {x:.2f}, y = {y:.2f}; max_slope allows {math.degrees(allowed):.1f} degrees",
        tuple(remedies),
        (span,),
    )


def _beside_volume(environment: Environment, span: str, of_volume: str) -> Explanation:
    """V where surface was measured beside it, or where no part of what it holds is large enough."""
    volume, settings = environment.volume, RegionSettings()
    # the widest floor of V must have room for a region
    sides = (volume.joined[:, 1] - volume.joined[:, 0])[:, :2]
    width, depth = sides[np.argmax(sides.prod(axis=1))]
    if width * depth < 2.0 * settings.min_area:
        return Explanation(
            f"{_HEAD}: `volume` is only {width:.3g} x {depth:.3g} m wide; a region has more "
            f"than {1e4 * settings.min_area:g} cm²",
            (Remedy("volume", "make it wider"),),
            (span,),
        )
    # of all boxes of V the surface that is the least beyond one of them
    nearest = min(
        (found for box in volume.boxes if (found := _nearest_level(environment, box)) is not None),
        key=lambda found: abs(found[1]),
        default=None,
    )
    if nearest is not None and nearest[1] != 0.0:
        height, beyond = nearest
        below = beyond < 0.0
        bound = "minimum z" if below else "maximum z"
        # a little farther than the surface, which noise moves
        reached = height + math.copysign(settings.headroom, beyond)
        return Explanation(
            f"{_HEAD}: nothing was measured in `volume`; the nearest lies "
            f"{abs(beyond):.3f} m {'under' if below else 'above'} it, at z = {height:.3f}",
            (
                Remedy("volume", f"set its {bound} to {reached:.3f}"),
                _ALIGN,
            ),
            (span,),
        )
    if nearest is None:
        return Explanation(
            f"{_HEAD}: nothing was measured in, under or above `volume` ({of_volume})",
            (Remedy("volume", "move it over what was measured"), _ALIGN),
            (span,),
        )
    # something was measured in V, but nothing that is a region
    size, usual = environment.measured.cell_size, GridSettings().cell_size
    finer = Remedy("cell_size", f"lower it: {size:g} m is set, {usual:g} m is usual")
    return Explanation(
        f"{_HEAD}: nothing in `volume` is level, measured without holes, larger than "
        f"{1e4 * settings.min_area:g} cm² and free for {settings.headroom:g} m above it",
        (
            *((finer,) if size > usual else ()),
            Remedy("volume", "choose one with a level surface in it"),
            Remedy("environment", "give a denser cloud, if it has holes there"),
            _ALIGN,
        ),
        (span,),
    )


def _nearest_level(environment: Environment, box: Array) -> tuple[float, float] | None:
    """Of what lies over or under a box (2, 3): the height nearest to its z at which a good part of
    it was measured, and how far above (or below, negative) that is, m; None without any."""
    measured = environment.measured
    middle = 0.5 * (measured.lower + measured.upper)
    over = ((middle[:, :2] >= box[0, :2]) & (middle[:, :2] <= box[1, :2])).all(axis=1)
    heights, level = measured.upper[over, 2], 2.0 * CONTACT_TOLERANCE_M
    # heights at which a good part of the floor of the box was measured
    levels, counts = np.unique(np.round(heights / level), return_counts=True)
    area = min(_LEVEL_AREA_M2, 0.5 * float((box[1] - box[0])[:2].prod()))
    levels = levels[counts * measured.cell_size**2 >= area] * level
    if len(levels) == 0:
        return None
    # 0 within the box, positive above it, negative below
    beyond = np.maximum(levels - box[1, 2], 0.0) + np.minimum(levels - box[0, 2], 0.0)
    best = int(np.argmin(np.abs(beyond)))
    return float(levels[best]), float(beyond[best])


def regions_in_words(environment: Environment) -> list[str]:
    """How many regions, how large; how much of V was seen, where that is known."""
    regions = environment.regions
    words = []
    if regions:
        total, largest = sum(region.area for region in regions), regions[0]
        words.append(
            f"placement regions in `volume`: {len(regions)}, together {total:.4f} m², the "
            f"largest {largest.area:.4f} m²"
        )
        slope = steepness(largest.slope)
        words[-1] += f", sloping by {math.degrees(slope):.1f} degrees" if slope else ""
    if environment.seen is not None:
        words.append(f"the sensors have seen {environment.seen:.0%} of `volume`")
    return words


def _box_in_words(box: Array) -> str:
    sides = zip("xyz", *box.tolist(), strict=True)
    return ", ".join(f"{name} {low:.5g} to {high:.5g}" for name, low, high in sides)
