"""Placement regions in words: which there are, or what of V is why there are none."""

from __future__ import annotations

import math

import numpy as np

from placement_planner_ros.core.explanation.explanation import SENSOR, Explanation, Remedy
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.grid import GridSettings
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
        given = [Remedy("environment", "give points of the surroundings")]
        words = "the cloud is empty, or none of its points is finite"
        if own := environment.near.left_out:
            given += [Remedy("own points", "leave out no more than the robot and what it holds")]
            words = f"all {own:,} points of the clouds are taken for the robot's or the object's"
        return Explanation(f"no placement region: {words}", tuple(given))
    words, remedies = (
        _none_in_reach(environment)
        or too_steep(environment)
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
    """(2,) the rise of a surface steeper than `max_slope` that most of what was measured in V is;
    None where there is no such."""
    if not environment.steep:  # as mostly, and points are many
        return None
    measured = environment.measured
    points = measured.points.astype(np.float64)
    points = points[environment.volume.contains(points)]
    area = len(np.unique(np.floor(points[:, :2] / measured.cell_size), axis=0))
    for plane in environment.steep:
        off = points[:, 2] - plane.height - points[:, :2] @ np.array(plane.slope)
        on = int((np.abs(off) <= measured.surface_tolerance + 3.0 * measured.noise).sum())
        # a plane goes on where the surface that it is of does not
        if 2 * on > len(points) and plane.area > 0.5 * area * measured.cell_size**2:
            return np.array(plane.slope)
    return None


def too_steep(environment: Environment) -> Cause | None:
    """That most of what was measured in V is steeper than `max_slope`; None where it is not."""
    rise = _steep_slope(environment)
    if rise is None:
        return None
    slope, (x, y) = steepness(rise), rise / np.hypot(*rise)
    by = f"{math.degrees(slope):.1f} degrees"
    remedies = [Remedy(SENSOR, f"correct the sensor's tilt by {by}, if the surface is level")]
    if slope <= meaning_of(RegionSettings(), "max_slope").ends[1]:
        # half as much friction again as the slope takes
        to, friction = math.ceil(1e3 * slope) / 1e3, 1.5 * math.tan(slope)
        words = f"raise it to {to:.3f}, if friction there is {friction:.2f} or more"
        remedies.append(Remedy("max_slope", words))
    return (
        f"most of what was measured in `volume` slopes by {by}, rising towards x = {x:.2f}, "
        f"y = {y:.2f}; `max_slope` allows {math.degrees(environment.max_slope):.1f} degrees",
        (*remedies, Remedy("volume", "choose one with a level surface, if it is not")),
    )


COARSE, FINE = "coarse cell_size", "fine cell_size"


def unusual_cells(environment: Environment) -> dict[str, str]:
    """How to change a `cell_size` that is not the usual one, in words, by `COARSE` or `FINE`."""
    size, usual = environment.measured.cell_size, GridSettings().cell_size
    kind, change = (COARSE, "lower") if size > usual else (FINE, "raise")
    words = f"{change} it: {size:g} m is set, {usual:g} m is usual"
    return {} if size == usual else {kind: words}


def _beside_volume(environment: Environment) -> Cause | None:
    """That most of what was measured over and under V is beyond it; None where it is not."""
    found = [_mostly_at(environment, box) for box in environment.volume.boxes]
    # of all boxes of V the surface that is the least beyond one of them
    nearest = min(filter(None, found), key=lambda each: abs(each[2]), default=None)
    if nearest is None or nearest[2] == 0.0:
        return None
    lowest, highest, beyond = nearest
    side, bound = ("under", "minimum z") if beyond < 0.0 else ("above", "maximum z")
    words = f"what was measured over and under `volume` lies mostly {abs(beyond):.3f} m {side} it"
    headroom = RegionSettings().headroom
    # what is at no one height is no surface
    if highest - lowest > headroom:
        return f"{words}, between z = {lowest:.3f} and {highest:.3f}", (_ALIGN,)
    # a little farther than the surface, which noise moves
    height = 0.5 * (lowest + highest)
    reached = height + math.copysign(headroom, beyond)
    return (
        f"{words}, at z = {height:.3f}",
        (Remedy("volume", f"set its {bound} to {reached:.3f}"), _ALIGN),
    )


def _not_a_region(environment: Environment) -> Cause:
    """What a region needs."""
    settings = RegionSettings()
    return (
        f"nothing in `volume` was found to be level, measured without holes, larger than "
        f"{1e4 * settings.min_area:g} cm² and free for {settings.headroom:g} m above it",
        (
            *(Remedy("cell_size", words) for words in unusual_cells(environment).values()),
            Remedy("volume", "choose one with a level surface in it"),
            Remedy("environment", "give a denser cloud, if it has holes there"),
            _ALIGN,
        ),
    )


def _mostly_at(environment: Environment, box: Array) -> tuple[float, float, float] | None:
    """Of the points over and under a box (2, 3): between which heights the middle half of them
    lies, and how far above (or below, negative) the box the median by distance is, m; None where
    there are none."""
    points = environment.measured.points
    over = ((points[:, :2] >= box[0, :2]) & (points[:, :2] <= box[1, :2])).all(axis=1)
    heights = points[over, 2].astype(np.float64)
    if len(heights) == 0:
        return None
    # 0 within the box, positive above it, negative below
    beyond = np.maximum(heights - box[1, 2], 0.0) + np.minimum(heights - box[0, 2], 0.0)
    median = float(beyond[np.argsort(np.abs(beyond))[len(beyond) // 2]])
    lowest, highest = np.quantile(heights[beyond * median >= 0.0], (0.25, 0.75)).tolist()
    return lowest, highest, median


def regions_in_words(environment: Environment) -> list[str]:
    """How many regions, how large; how much of V was seen, where that is known."""
    regions = environment.regions
    words = []
    if regions:
        steep = too_steep(environment)
        words += [] if steep is None else [steep[0]]
        words.append(
            f"placement regions in `volume`: {len(regions)}, the largest {regions[0].area:.4f} m²"
        )
    if environment.seen is not None:
        words.append(f"the sensors have seen {environment.seen:.0%} of `volume`")
    return words
