"""What target_volume holds: why no placement region, or how large they are, in words."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_closing

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.explanation.explanation import SENSOR, Explanation, Remedy
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.settings import meaning_of
from placement_planner_ros.core.types import LEVEL, Array, TargetVolume, steepness

MERGED = Remedy("cloud.mode", "merge, where several clouds together show the whole surface")

Mask = npt.NDArray[np.bool_]
Index = npt.NDArray[np.int64]

_COVERED = 0.25
"""Share of V's columns with something in V, of those with anything at all, for that to count."""
_STEEPEST = 4.0
"""Cells by which the surface may rise over two columns, to be taken for one surface."""
_FITS = 3
"""Times that a plane is fitted to what lies near the one before."""
_PAIRS = 10
"""Pairs of columns, at least, that show a slope."""
_LONELY = 0.5
"""Share of holes from which on no surface shows."""
_BARE = 0.5
"""Share of V's ground over which nothing was measured, to be named."""
_ACROSS = 3
"""Cells from what was measured to the middle of a hole, at most."""
_LARGEST_CELL = 0.1
"""m, the largest cloud.cell_size."""
_LOOKED_AT = 200
"""Tops whose free height is looked at."""
_THICK = 0.005
"""m: what is no higher than this above a surface is part of it."""
_SPARSE = 0.62
"""Cells that points are apart, from which on too few lie around a cell to tell noise ..."""
_NOISY = 0.0003
"""... of so many metres from relief."""
_FINE = 0.5
"""Times as far apart do points tell them."""
_UNEVEN = 0.001
"""m of standard deviation of the surface's height, to be named."""
_SMOOTH = 4.0
"""Cells of so many standard deviations level out how points scatter."""
_ROOM = 2.0
"""Times the smallest region that V is wide, below which that is too narrow."""
_FAR = 50.0
"""m: points further away are perhaps in another unit."""
_CLEAR = 0.01
"""m, how far V should reach beyond a surface that it is made to hold."""
_MEASURED = 0.005
"""rad that a measured slope may be off by."""
_LEVELS = 0.01
"""m: surfaces whose heights differ by less are taken for one."""
_ENOUGH = 0.0025
"""m² of surface at one height that is worth naming."""


def why_no_region(environment: Environment) -> Explanation:
    """Why V holds no placement region."""
    head = "no placement region"
    volume, measured = environment.volume, environment.measured
    if environment.points == 0:
        return Explanation(
            f"{head}: the clouds show nothing: no point is left of them once those on the robot "
            "and on the held object are taken out",
            (
                Remedy("cloud_topics", "name the topics with clouds of the surroundings"),
                Remedy("self_filter.padding", "lower it where it takes out more than the robot"),
            ),
        )
    span = f"the {environment.points:,} points of the clouds span {_corners(*environment.extent)}"
    aligned = Remedy(SENSOR, "correct the pose of the sensor, if the points are not where it is")
    if len(measured) == 0:
        far = bool(np.abs(environment.extent).max() > _FAR)
        scale = "; they are taken to be metres" if far else ""
        in_metres = Remedy("cloud_topics", "name topics with clouds in metres, not in millimetres")
        return Explanation(
            f"{head}: no point of the clouds lies where the robot could reach: {span}{scale}; "
            f"target_volume is {_extent(volume)}",
            (
                *((in_metres,) if far else ()),
                Remedy(SENSOR, "give the pose of the sensor's frame, in metres"),
                Remedy("planning_frame", "name the frame that target_volume is meant in"),
            ),
        )
    tops = _tops(environment)
    within = np.isfinite(tops)
    slope = steep_in(environment)
    if slope is not None and within.mean() > _COVERED:
        cause = f"{head}: {sloping(slope, environment.max_slope)}"
        return Explanation(cause, level(slope), (span,))
    above = _free_above(environment)
    if above < RegionSettings().headroom and within.mean() > _COVERED:
        return Explanation(
            f"{head}: above most of what was measured in target_volume only {above:.3f} m are "
            f"free; something can stand on it where {RegionSettings().headroom:g} m are",
            (Remedy("target_volume", "choose one with more free height"), aligned),
            (span,),
        )
    elsewhere = _elsewhere(environment)
    if elsewhere is not None:
        number, height, gap = elsewhere
        it = f"its box {number + 1}" if len(volume.boxes) > 1 else "it"
        if height < volume.boxes[number, 0, 2]:
            where, bound = "under", f"minimum z (number {6 * number + 3})"
            to = f"{height - _CLEAR:.3f} or less"
        else:
            where, bound = "above", f"maximum z (number {6 * number + 6})"
            to = f"{height + _CLEAR:.3f} or more"
        return Explanation(
            f"{head}: target_volume holds no level surface; the nearest lies {gap:.3f} m {where} "
            f"{it}, at z = {height:.3f}",
            (Remedy("target_volume", f"set its {bound} to {to}"), aligned),
            (span,),
        )
    if not _columns(environment).any():
        near = _nearest(environment)
        over = "move it over what was measured"
        if near is not None:
            over += f": the nearest level surface is at ({near[0]:.3f}, {near[1]:.3f}) m"
            over += f" with z = {near[2]:.3f}"
        return Explanation(
            f"{head}: nothing was measured in, under or above target_volume ({_extent(volume)})",
            (Remedy("target_volume", over), aligned),
            (span,),
        )
    holes = holes_in(environment)
    if holes > _LONELY and (hidden := shown(environment)):
        bare = f"over {bare_in(environment):.0%} of target_volume nothing was measured"
        return Explanation(f"{head}: {bare}", (*hidden, aligned), (span,))
    if holes > _LONELY:
        return Explanation(
            f"{head}: the points in target_volume lie too far apart to show a surface: "
            f"{holes:.0%} of it are holes",
            (coarser(environment), MERGED),
            (span,),
        )
    tries, told = too_sparse(environment)
    smallest, headroom = RegionSettings().min_area, RegionSettings().headroom
    sides = (volume.joined[:, 1] - volume.joined[:, 0])[:, :2]
    width, depth = sides[np.argmax(sides.prod(axis=1))]
    if width * depth < _ROOM * smallest:
        only = "only" if len(volume.joined) == 1 else "nowhere more than"
        return Explanation(
            f"{head}: target_volume is {only} {width:.3f} x {depth:.3f} m wide; a region has more "
            f"than {1e4 * smallest:g} cm²",
            (Remedy("target_volume", "make it wider"),),
            (span,),
        )
    return Explanation(
        f"{head}: nothing in target_volume is level, larger than {1e4 * smallest:g} cm² and free "
        f"for {headroom:g} m above it",
        (
            *(tries or smoother(environment)),
            Remedy("target_volume", "choose one with a level surface in it"),
            aligned,
        ),
        (*(told or uneven_in_words(environment)), span),
    )


def smoother(environment: Environment) -> tuple[Remedy, ...]:
    """What to try where the surface in V is uneven; () where it is even."""
    scatter, size = scatter_in(environment), environment.measured.cell_size
    coarse = min(_SMOOTH * scatter, _LARGEST_CELL)
    if scatter < _UNEVEN or coarse <= size:
        return ()
    words = f"set it to about {coarse:.2f}, if the surface is level and the points scatter"
    return (Remedy("cloud.cell_size", words),)


def uneven_in_words(environment: Environment) -> tuple[str, ...]:
    """How uneven the surface in V is; () where it is even."""
    scatter = scatter_in(environment)
    if scatter < _UNEVEN:
        return ()
    return (
        f"the surface in target_volume is uneven: its heights scatter by {scatter:.4f} m about a "
        "plane",
    )


def too_sparse(environment: Environment) -> tuple[tuple[Remedy, ...], tuple[str, ...]]:
    """What to try, and what is seen, where points are noisy and too few to tell that from relief;
    nothing where they are dense or even."""
    measured, rows = environment.measured, _within(environment)
    columns = int(np.isfinite(_tops(environment)).sum())
    points = int(np.diff(measured.surface_first)[rows].sum())
    scatter = max(scatter_in(environment), measured.noise)
    spacing = measured.cell_size / math.sqrt(max(points, 1) / max(columns, 1))
    if points == 0 or spacing < _SPARSE * measured.cell_size or scatter < _NOISY:
        return (), ()
    size = min(2.0 * spacing, _LARGEST_CELL)
    tries = (
        Remedy(
            "cloud_topics",
            f"name a finer cloud: one that no filter has thinned, or by voxels of "
            f"{_FINE * spacing:.3f} m at most",
        ),
        Remedy(
            "cloud.cell_size",
            f"set it to about {size:.3f}, if nothing low lies there: what is as low as the noise "
            "goes unseen then",
        ),
    )
    seen = (
        f"the points in target_volume are {spacing:.4f} m apart and scatter by {scatter:.4f} m: "
        "that many do not tell noise from what is low",
    )
    return tries, seen


def steep_in(environment: Environment) -> Array | None:
    """(2,) slope of the largest plane in V that is steeper than `max_slope`, if such planes are a
    good part of the surface there, or of most of what was measured; None without."""
    volume = environment.volume
    steep = [plane for plane in environment.steep if volume.contains(plane.middle)]
    area = sum(plane.area for plane in steep)
    if steep and area >= _COVERED * (area + sum(r.area for r in environment.regions)):
        return np.array(steep[0].slope)
    if sum(region.area for region in environment.regions) > (1.0 - _COVERED) * _ground(environment):
        return None  # to what fits one plane, a step between level surfaces is a slope
    slope = slope_in(environment)  # planes are sought up to 20 degrees
    return slope if steepness(slope) > environment.max_slope + _MEASURED else None


def sloping(slope: Array, max_slope: float) -> str:
    """That surface rises by so much along x and y (2,)."""
    x, y = np.round(slope / max(float(np.hypot(*slope)), 1e-9), 2) + 0.0  # no -0.00
    return (
        f"what was measured in target_volume slopes by {_degrees(slope):.1f} degrees, rising "
        f"towards x = {x:.2f}, y = {y:.2f}; max_slope allows {math.degrees(max_slope):.1f} degrees"
    )


def level(slope: Array) -> tuple[Remedy, ...]:
    """What to try where surface slopes; where it does so by much, the sensor's pose is suspected
    first."""
    steep = steepness(slope)
    words = f"correct the sensor's tilt by {_degrees(slope):.1f} degrees, if the surface is level"
    turned = Remedy(SENSOR, f"{words} in truth")
    elsewhere = Remedy("target_volume", "choose one with a level surface, if it is not")
    meaning = meaning_of(RegionSettings(), "max_slope")
    most = math.ceil(1000.0 * steep) / 1000.0
    if most > meaning.ends[1]:
        return turned, elsewhere
    friction = 1.5 * math.tan(steep)
    words = f"raise it to {most:.3f}, if friction there is {friction:.2f} or more"
    allowed = Remedy("max_slope", words)
    first = (turned, allowed) if steep > RegionSettings().max_slope else (allowed, turned)
    return *first, elsewhere


def slope_in(environment: Environment) -> Array:
    """(2,) how much most of what was measured in V rises along x and y, m per m; 0 where that
    cannot be told.

    Steps between columns show roughly how; the plane through what lies near that shows it well.
    """
    tops, size = _tops(environment), environment.measured.cell_size
    slope: Array = np.zeros(2)
    for axis, step in enumerate((tops[2:] - tops[:-2], tops[:, 2:] - tops[:, :-2])):
        of_one = step[np.abs(step) <= _STEEPEST * size]
        if len(of_one) < _PAIRS:
            return np.zeros(2)
        slope[axis] = float(np.median(of_one)) / (2.0 * size)
    middles, height = _points_on_top(environment)
    across = np.column_stack([middles, np.ones(len(middles))])
    plane: Array = np.append(slope, np.median(height - middles @ slope))
    for _ in range(_FITS):
        near = np.abs(height - across @ plane) <= 1.5 * size
        if near.sum() < _PAIRS:
            break
        plane = np.asarray(np.linalg.lstsq(across[near], height[near], rcond=None)[0])
    return np.asarray(plane[:2])


def _points_on_top(environment: Environment) -> tuple[Array, Array]:
    """(k, 2) and (k,) where the boxes with their top in V have it."""
    measured, rows = environment.measured, _within(environment)
    extent = measured.surface_extent[rows]
    middles = np.column_stack([extent[:, :2].mean(axis=1), extent[:, 2:4].mean(axis=1)])
    return middles, measured.surface_height[rows]


def _degrees(slope: Array) -> float:
    return math.degrees(math.atan(float(np.hypot(*slope))))


def bare_in(environment: Environment) -> float:
    """Share of V's columns in which nothing was measured, at whatever height, nor around them."""
    measured = environment.measured
    whole, filled = np.zeros((2, *measured.shape[:2]), dtype=np.bool_)
    for box in environment.volume.joined:
        low, high = np.floor((box[:, :2] - measured.origin[:2]) / measured.cell_size).astype(int)
        low, end = low.clip(min=0), (high + 1).clip(min=0)
        whole[low[0] : end[0], low[1] : end[1]] = True
    cells = measured.cells[_inside(environment)]
    filled[cells[:, 0], cells[:, 1]] = True
    between = binary_closing(np.pad(filled, _ACROSS), np.ones((2 * _ACROSS + 1, 2 * _ACROSS + 1)))
    around = between[_ACROSS:-_ACROSS, _ACROSS:-_ACROSS]  # points may be sparse
    return 1.0 - float((around & whole).sum() / max(whole.sum(), 1))


def shown(environment: Environment) -> tuple[Remedy, ...]:
    """What to try where nothing was measured over most of V; () where something was."""
    bare = bare_in(environment)
    if bare < _BARE:
        return ()
    words = (
        f"move it over what was measured: over {bare:.0%} of it nothing was, neither above nor "
        "below; or, where a surface there is hidden, show it: clouds from further sides, with "
        "cloud.mode: merge"
    )
    return (Remedy("target_volume", words),)


def seen_in_words(environment: Environment) -> tuple[str, ...]:
    """How much of V the sensors saw; () where that does not matter, or nobody knows."""
    if environment.seen is None:
        return ()
    return (f"the sensors have seen {environment.seen:.0%} of target_volume",)


def holes_in(environment: Environment) -> float:
    """Share of the surface in V that shows no point: columns that what was measured surrounds."""
    filled = np.pad(np.isfinite(_tops(environment)), _ACROSS)
    closed = binary_closing(filled, np.ones((2 * _ACROSS + 1, 2 * _ACROSS + 1)))
    return 1.0 - float(filled.sum() / max(closed.sum(), 1))


def scatter_in(environment: Environment) -> float:
    """Standard deviation of the surface in V about the plane through most of it, m."""
    middles, height = _points_on_top(environment)
    if len(height) < _PAIRS:
        return 0.0
    off = height - middles @ slope_in(environment)
    off = np.abs(off - np.median(off))
    near = off <= 1.5 * environment.measured.cell_size
    return float(np.sqrt((off[near] ** 2).mean()))


def coarser(environment: Environment) -> Remedy:
    """What to try where points are sparse."""
    share = float(_columns(environment).mean())
    spacing = environment.measured.cell_size / math.sqrt(max(share, 0.01))
    size = min(2.0 * spacing, _LARGEST_CELL)
    return Remedy("cloud.cell_size", f"set it to twice the spacing of the points, about {size:.2f}")


def in_words(environment: Environment) -> str:
    """Which regions there are, and how much is free above them."""
    regions = environment.regions
    if not regions:
        return "target_volume holds no placement region"
    largest = regions[0]
    width, depth = _size(largest.rectangles)
    total = sum(region.area for region in regions)
    many = f"{len(regions)} placement regions" if len(regions) > 1 else "one placement region"
    words = f"target_volume holds {many} ({total:.4f} m²), the largest {width:.3f} x {depth:.3f} m"
    middle = 0.5 * (largest.rectangles[0, :2] + largest.rectangles[0, 2:])
    words += f" at z = {float(largest.heights(middle[None])[0]):.3f}"
    if largest.slope != LEVEL:
        words += f", sloping by {_degrees(np.array(largest.slope)):.1f} degrees"
    free = headroom(environment)
    return words if math.isinf(free) else f"{words}; free above them are at most {free:.3f} m"


def headroom(environment: Environment) -> float:
    """Most height that is free above the middle of any part of a region, m; inf for no end."""
    obstacles = environment.obstacles
    best = 0.0
    for region in environment.regions:
        middles = 0.5 * (region.rectangles[:, :2] + region.rectangles[:, 2:])
        for x, y in middles[:: max(1, len(middles) // 8)]:
            i, j = np.floor(((x, y) - obstacles.origin[:2]) / obstacles.cell_size).astype(int)
            heights = obstacles.lower[column(obstacles, int(i), int(j)), 2]
            z = float(region.heights(np.array([[x, y]]))[0])
            above = heights[heights > z + 2.0 * RegionSettings().height_tolerance]
            if len(above) == 0:
                return math.inf
            best = max(best, float(above.min()) - z)
    return best


def _free_above(environment: Environment) -> float:
    """Free height above most of the tops in V, m."""
    measured, rows = environment.measured, _within(environment)
    free = [math.inf]
    for row in rows[:: max(1, len(rows) // _LOOKED_AT)].tolist():
        i, j, _ = measured.cells[row].tolist()
        height = float(measured.surface_height[row])
        others = measured.lower[column(measured, i, j), 2]
        free.append(float(np.min(others[others > height + _THICK], initial=math.inf)) - height)
    return float(np.median(free))


def column(obstacles: ObstacleSet, i: int, j: int) -> list[int]:
    """The boxes of one column of cells; none where it lies outside the grid."""
    nx, ny, _ = obstacles.shape
    rows: list[int] = []
    if 0 <= i < nx and 0 <= j < ny:
        for number in obstacles.number_at[i, j].tolist():
            box = number - 1
            while box >= 0:
                rows.append(box)
                box = int(obstacles.next[box])
    return rows


def rest_in_words(body: Body, face: int) -> str:
    """Which rest that is."""
    width, depth, height = rest_size(body, face)
    return f"face {face} ({width:.3f} x {depth:.3f} m, {height:.3f} m high)"


def rest_size(body: Body, face: int) -> tuple[float, float, float]:
    """Width and depth of the face and height of the body that rests on it, m."""
    T = body.faces[face].T_face_object
    on = body.faces[face].vertices @ T.rotation.T
    width, depth = np.ptp(on[:, :2], axis=0)
    return float(width), float(depth), float(np.ptp(body.vertices @ T.rotation.T[:, 2]))


def _columns(environment: Environment) -> Mask:
    """(nx, ny) bool, in which of V's columns anything was measured, at whatever height."""
    cells, low, shape = _cells(environment)
    result = np.zeros(shape, dtype=np.bool_)
    result[cells[:, 0] - low[0], cells[:, 1] - low[1]] = True
    return result


def _ground(environment: Environment) -> float:
    """m² of V's ground over which something was measured, at most."""
    of_columns = float(_columns(environment).sum()) * environment.measured.cell_size**2
    boxes = environment.volume.joined
    return min(of_columns, float((boxes[:, 1, :2] - boxes[:, 0, :2]).prod(axis=1).sum()))


def _tops(environment: Environment) -> Array:
    """(nx, ny) height of the highest surface in V of each of its columns; NaN without."""
    _, low, shape = _cells(environment)
    measured, rows = environment.measured, _within(environment)
    result = np.full(shape, -np.inf)
    at = measured.cells[rows, 0] - low[0], measured.cells[rows, 1] - low[1]
    np.maximum.at(result, at, measured.surface_height[rows])
    return np.where(np.isfinite(result), result, np.nan)


def _within(environment: Environment) -> Index:
    """(k,) the boxes with their top in V."""
    height = environment.measured.surface_height
    within = np.zeros(len(height), dtype=np.bool_)
    for box in environment.volume.joined:
        level = (height >= box[0, 2]) & (height <= box[1, 2])
        within |= level & _in_columns(environment.measured, box)
    return np.flatnonzero(within)


def _cells(environment: Environment) -> tuple[Index, Index, tuple[int, int]]:
    """Cells (k, 3) of the boxes in V's columns, the first column (2,) and how many hold them."""
    cells = environment.measured.cells[_inside(environment)].astype(np.int64)
    if len(cells) == 0:
        return cells, np.zeros(2, dtype=np.int64), (1, 1)
    low = cells[:, :2].min(axis=0)
    nx, ny = (cells[:, :2].max(axis=0) - low + 1).tolist()
    return cells, low, (nx, ny)


def _inside(environment: Environment) -> Mask:
    """(m,) which boxes lie in V's columns."""
    boxes = [_in_columns(environment.measured, box) for box in environment.volume.joined]
    return np.asarray(np.any(boxes, axis=0))


def _in_columns(measured: ObstacleSet, box: Array) -> Mask:
    """(m,) which boxes lie in the columns of one of V's (2, 3)."""
    low, high = np.floor((box[:, :2] - measured.origin[:2]) / measured.cell_size)
    columns = measured.cells[:, :2]
    return np.asarray(((columns >= low) & (columns <= high)).all(axis=1))


def _elsewhere(environment: Environment) -> tuple[int, float, float] | None:
    """The box of V that a level surface lies nearest above or under, its height, and how far from
    that box it is, m."""
    found = []
    for number, box in enumerate(environment.volume.boxes):
        level = _level_beyond(environment, box)
        if level is not None:
            found.append((number, *level))
    return min(found, key=lambda each: each[2], default=None)


def _level_beyond(environment: Environment, box: Array) -> tuple[float, float] | None:
    """Height of the level surface nearest above or under a box of V (2, 3), and how far, m."""
    support = environment.support
    low = np.maximum(support.rectangle[:, :2], box[0, :2])
    size = np.maximum(np.minimum(support.rectangle[:, 2:], box[1, :2]) - low, 0.0)
    areas = size.prod(axis=1)
    outside = (support.height < box[0, 2]) | (support.height > box[1, 2])
    rows = np.flatnonzero(outside & (areas > 0.0))
    if len(rows) == 0:
        return None
    levels = np.round(support.height[rows] / _LEVELS).astype(np.int64)
    best = None
    for one in np.unique(levels):
        here = rows[levels == one]
        if areas[here].sum() < _ENOUGH:
            continue
        height = float(np.average(support.height[here], weights=areas[here]))
        gap = max(box[0, 2] - height, height - box[1, 2])
        if best is None or gap < best[1]:
            best = height, float(gap)
    return best


def _nearest(environment: Environment) -> Array | None:
    """(3,) middle of the level surface nearest to V; None without any."""
    volume, support = environment.volume, environment.support
    if len(support.height) == 0:
        return None
    middle = 0.5 * (support.rectangle[:, :2] + support.rectangle[:, 2:])
    points = np.column_stack([middle, support.height])
    return np.asarray(points[np.argmin(_distance(points, volume))])


def _distance(points: Array, volume: TargetVolume) -> Array:
    """(n,) m of points (n, 3) from V."""
    away = [np.maximum(np.maximum(a - points, points - b), 0.0) for a, b in volume.joined]
    return np.asarray(np.linalg.norm(away, axis=2).min(axis=0))


def _size(rectangles: Array) -> tuple[float, float]:
    width, depth = rectangles[:, 2:].max(axis=0) - rectangles[:, :2].min(axis=0)
    return float(width), float(depth)


def _extent(volume: TargetVolume) -> str:
    """Where V lies, in words."""
    several = f"{len(volume.boxes)} boxes within " if len(volume.boxes) > 1 else ""
    return several + _corners(volume.lower, volume.upper)


def _corners(lower: Array, upper: Array) -> str:
    """A box in words."""
    sides = zip("xyz", lower, upper, strict=True)
    return ", ".join(f"{name} {low:.3f} to {high:.3f}" for name, low, high in sides)


def smallest_rest(body: Body) -> int:
    """The face with the smallest extent, by its longer side."""
    sizes = [max(rest_size(body, face)[:2]) for face in range(len(body.faces))]
    return int(np.argmin(sizes))


def lowest_rest(body: Body) -> int:
    """The face on which the body is lowest."""
    return int(np.argmin([rest_size(body, face)[2] for face in range(len(body.faces))]))
