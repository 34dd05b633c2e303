"""Placement regions in words: which there are, or what of V is why there are none."""

from __future__ import annotations

import math

import numpy as np

from placement_planner_ros.core.explanation.explanation import SENSOR, Explanation, Remedy
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.settings import meaning_of
from placement_planner_ros.core.types import Array, steepness

_ALIGN = Remedy(SENSOR, "correct the pose of the sensor, if the points are not where it is")

Cause = tuple[str, tuple[Remedy, ...]]
"""In words, and what to try."""


def why_no_region(environment: Environment) -> Explanation:
    """The first of these that holds: no points, none in reach, steep, above, below or
    beside V; else what a region needs."""
    if environment.points == 0:
        own = environment.near.left_out
        given = Remedy("environment", "give points of the surroundings")
        if not own:
            return Explanation("no placement region: the cloud is empty", (given,))
        leave = Remedy("own points", "leave out no more than the robot and what it holds")
        words = f"all {own:,} points of the clouds are taken for those of the robot or the object"
        return Explanation(f"no placement region: {words}", (given, leave))
    words, remedies = (
        _none_in_reach(environment)
        or _too_steep(environment)
        or _beside_volume(environment)
        or _not_a_region(environment)
    )
    return Explanation(f"no placement region: {words}", remedies)


def _none_in_reach(environment: Environment) -> Cause | None:
    """That all points lie outside of the workspace."""
    if len(environment.measured):
        return None
    sides = zip("xyz", *environment.extent.tolist(), strict=True)
    span = ", ".join(f"{name} {low:.5g} to {high:.5g}" for name, low, high in sides)
    return (
        f"no point of the clouds lies where the robot could reach: the {environment.points:,} "
        f"points span {span}, taken to be metres",
        (
            Remedy("environment", "give points in metres, if these are not"),
            Remedy(SENSOR, "give the pose of the sensor's frame, in metres"),
            Remedy("root frame", "name the one that `volume` is meant in"),
        ),
    )


def _steep_slope(environment: Environment) -> Array | None:
    """(2,) the rise of the largest surface in V that is steeper than `max_slope`."""
    # the first plane is the largest
    steep = (
        plane.slope for plane in environment.steep if environment.volume.contains(plane.middle)
    )
    return next((np.array(slope) for slope in steep), None)


def slope_to_allow(environment: Environment) -> str | None:
    """What to raise `max_slope` to, in words, where that lets the largest surface carry."""
    rise = _steep_slope(environment)
    slope = 0.0 if rise is None else steepness(rise)
    if rise is None or slope > meaning_of(RegionSettings(), "max_slope").ends[1]:
        return None
    # half as much friction again as the slope takes
    to, friction = math.ceil(1e3 * slope) / 1e3, 1.5 * math.tan(slope)
    return f"raise it to {to:.3f}, if friction there is {friction:.2f} or more"


def _too_steep(environment: Environment) -> Cause | None:
    """That the largest surface in V is steeper than `max_slope`; None where it is not."""
    rise, allow = _steep_slope(environment), slope_to_allow(environment)
    if rise is None:
        return None
    by = f"{math.degrees(steepness(rise)):.1f} degrees"
    x, y = rise / np.hypot(*rise)
    return (
        f"the largest surface in `volume` slopes by {by}, rising towards x = {x:.2f}, "
        f"y = {y:.2f}; `max_slope` allows {math.degrees(environment.max_slope):.1f} degrees",
        (
            Remedy(SENSOR, f"correct the sensor's tilt by {by}, if the surface is level in truth"),
            *([] if allow is None else [Remedy("max_slope", allow)]),
            Remedy("volume", "choose one with a level surface, if it is not"),
        ),
    )


def _beside_volume(environment: Environment) -> Cause | None:
    """That most of what was measured over and under V is beyond it; None where it is not."""
    found = [_mostly_at(environment, box) for box in environment.volume.boxes]
    # of all boxes of V the surface that is the least beyond one of them
    nearest = min(filter(None, found), key=lambda each: abs(each[1]), default=None)
    if nearest is None or nearest[1] == 0.0:
        return None
    height, beyond = nearest
    side, bound = ("under", "minimum z") if beyond < 0.0 else ("above", "maximum z")
    # a little farther than the surface, which noise moves
    reached = height + math.copysign(RegionSettings().headroom, beyond)
    return (
        f"what was measured over and under `volume` lies mostly {abs(beyond):.3f} m {side} "
        f"it, at z = {height:.3f}",
        (Remedy("volume", f"set its {bound} to {reached:.3f}"), _ALIGN),
    )


def _not_a_region(environment: Environment) -> Cause:
    """What a region needs."""
    settings = RegionSettings()
    return (
        f"nothing in `volume` is level, measured without holes, larger than "
        f"{1e4 * settings.min_area:g} cm² and free for {settings.headroom:g} m above it",
        (
            Remedy("volume", "choose one with a level surface in it"),
            Remedy("environment", "give a denser cloud, if it has holes there"),
            _ALIGN,
        ),
    )


def _mostly_at(environment: Environment, box: Array) -> tuple[float, float] | None:
    """Of what was measured over and under a box (2, 3) the median by its distance: its height, and
    how far above (or below, negative) the box that is, m; None where nothing was."""
    measured = environment.measured
    middle = 0.5 * (measured.lower + measured.upper)
    over = ((middle[:, :2] >= box[0, :2]) & (middle[:, :2] <= box[1, :2])).all(axis=1)
    heights = measured.upper[over, 2]
    if len(heights) == 0:
        return None
    # 0 within the box, positive above it, negative below
    beyond = np.maximum(heights - box[1, 2], 0.0) + np.minimum(heights - box[0, 2], 0.0)
    median = np.argsort(np.abs(beyond))[len(beyond) // 2]
    return float(heights[median]), float(beyond[median])


def regions_in_words(environment: Environment) -> list[str]:
    """How many regions, how large; how much of V was seen, where that is known."""
    regions = environment.regions
    words = []
    if regions and (steep := _too_steep(environment)) is not None:
        words.append(steep[0])
    if regions:
        total, largest = sum(region.area for region in regions), regions[0].area
        words.append(
            f"placement regions in `volume`: {len(regions)}, together {total:.4f} m², the "
            f"largest {largest:.4f} m²"
        )
    if environment.seen is not None:
        words.append(f"the sensors have seen {environment.seen:.0%} of `volume`")
    return words
