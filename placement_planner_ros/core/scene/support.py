"""s(x): what may stand where, looked up in layers that are made when they are first asked for."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit

from placement_planner_ros.core.boxes import within
from placement_planner_ros.core.scene.cloud import SURE_NOISES
from placement_planner_ros.core.scene.layers import LAYER_STEP_M, Layer, SlopeCloud, make_layers
from placement_planner_ros.core.scene.rasters import MOST_HEIGHTS, TILE_M, Field
from placement_planner_ros.core.types import LEVEL, Array, Index, Index32, Mask, Slope, TargetVolume
from placement_planner_ros.core.uncounted import Uncounted

NOT_MADE, EMPTY = -1, -2
"""In place of a layer's number."""


class LayerStack(NamedTuple):
    """Layers as kernels read them, one behind the other."""

    low: int
    """Of the first height, in steps of `LAYER_STEP_M`."""
    number: Index32
    """(h,) the layer of each height, a step apart."""
    layout: Array
    """(l, 6) of each layer: x and y of the first pixel, m between pixels, how many along x and y,
    and which is the first of its pixels."""
    inside: Field
    """(p,) of all pixels of all layers, as those below, see `Layer`."""
    from_end: Field
    surface: Field
    top: Field


class SupportMap:
    """Every surface of one slope, in V and up to `AROUND_M` beside it: what a face may rest on.

    Attributes:
        slope: of the surfaces.
        noise: of the points, standard deviation, m.
        trim: m, the outermost of many noisy points lies beyond the true edge by about so much.
        tops: (k, 3) x, y and height of pieces of surface as large as a cell, with headroom.
    """

    def __init__(self, cloud: SlopeCloud) -> None:
        self.slope: Slope = cloud.slope
        self.noise = cloud.noise
        self.trim = 2.0 * cloud.noise
        self._cloud = cloud
        self.tops = cloud.tops
        self._layers: dict[float, list[Layer]] = {}
        self._numbers: dict[tuple[int, float], int] = {}
        self._stacks: dict[float, LayerStack] = {}
        self._lock = threading.Lock()

    def layer(self, height: float, tolerance: float) -> Layer | None:
        """The layer that answers for a height; None where nothing was measured there."""
        number = self._number(height, tolerance)
        if number == NOT_MADE:
            self._make([height], tolerance)
            number = self._number(height, tolerance)
        return None if number == EMPTY else self._layers[tolerance][number]

    def _number(self, height: float, tolerance: float) -> int:
        """Of the layer that answers for a height, or `NOT_MADE` or `EMPTY`."""
        return self._numbers.get((round(height / LAYER_STEP_M), tolerance), NOT_MADE)

    def _make(self, heights: Sequence[float], tolerance: float) -> None:
        """Add the layers that answer for some heights."""
        with self._lock:  # two threads may ask for them
            steps = dict.fromkeys(round(height / LAYER_STEP_M) for height in heights)
            missing = [step for step in steps if (step, tolerance) not in self._numbers]
            layers = self._layers.setdefault(tolerance, [])
            made = make_layers(self._cloud, [step * LAYER_STEP_M for step in missing], tolerance)
            for step, layer in zip(missing, made, strict=True):
                self._numbers[step, tolerance] = EMPTY if layer is None else len(layers)
                if layer is not None:
                    layers.append(layer)
            self._stacks.pop(tolerance, None)

    def _stack(self, tolerance: float) -> LayerStack:
        """All layers that there are by now."""
        with self._lock:
            if tolerance not in self._stacks:
                known = {s: n for (s, of), n in self._numbers.items() if of == tolerance}
                low, high = min(known, default=0), max(known, default=0)
                # the layer of every height from the lowest to the highest known
                number = np.full(high - low + 1, NOT_MADE, np.int32)
                for step, layer in known.items():
                    number[step - low] = layer
                self._stacks[tolerance] = _stacked_layers(
                    self._layers.get(tolerance, []), low, number
                )
            return self._stacks[tolerance]

    @classmethod
    def of_surfaces(
        cls, cloud: SlopeCloud, beside: float, height_tolerance: float, tolerance: float
    ) -> tuple[SupportMap, dict[float, Layer]]:
        """What answers s(x) on surfaces of a cloud, and the layers of those in V, by their heights.

        Args:
            beside, height_tolerance: of `heights`.
            tolerance: m that what carries may be above or below a layer.
        """
        support = cls(cloud)
        heights = support.heights(cloud.volume, beside, height_tolerance)
        support._make(heights, tolerance)
        layers = ((height, support.layer(height, tolerance)) for height in heights)
        return support, {height: layer for height, layer in layers if layer is not None}

    def heights(self, volume: TargetVolume, beside: float, tolerance: float) -> list[float]:
        """m, heights at which there is surface in V, those of most surface first.

        Surfaces that differ in height by no more than twice the tolerance are of one; in noise,
        what is that much nearer to one that has been found is of it, too.

        Args:
            beside: m around V, in x and y, in which surfaces count.
            tolerance: metres.
        """
        inside = np.zeros(len(self.tops), np.bool_)
        for lower, upper in volume.boxes:
            near = within(self.tops[:, :2], lower[:2] - beside, upper[:2] + beside)
            # of a plane that slopes, what lies within V at the place that is nearest
            at = np.clip(self.tops[:, :2], lower[:2], upper[:2])
            z = self.tops[:, 2] + at @ np.array(self.slope)
            inside |= near & (z >= lower[2] - tolerance) & (z <= upper[2] + tolerance)
        left = np.sort(self.tops[inside, 2])
        found: list[float] = []
        while len(left) and len(found) < MOST_HEIGHTS:
            # how many tops lie no more than twice the tolerance above each
            last = np.searchsorted(left, left + 2.0 * tolerance, side="right")
            many = last - np.arange(len(left))
            first = int(np.argmax(many))
            if many[first] < 3:  # a top and one to either side
                break
            # the median of the most is a height; what is near it is used up
            found.append(float(np.median(left[first : last[first]])))
            left = left[np.abs(left - found[-1]) > tolerance + self.noise]
        return found

    def above(self, points: Array) -> Array:
        """(n, 3) points with their height above the plane through the origin as z, metres."""
        if self.slope == LEVEL:
            return points
        result = points.copy()
        result[:, 2] -= points[:, :2] @ np.array(self.slope)
        return result

    def supported(self, points: Array, tolerance: float, margin: float = 0.0) -> Mask:
        """s(x) for each point: is there surface under it, within `tolerance` of its height?

        `gaps` says how far above each point that surface is, too.

        Args:
            points: (n, 3), metres.
            tolerance: metres, above or below.
            margin: metres to be kept from where the surface drops or was not seen. Where a thing
                stands in the way there, nothing is to be kept from.

        Returns:
            (n,)
        """
        return np.isfinite(self.gaps(points, tolerance, margin))

    def gaps(
        self,
        points: Array,
        tolerance: float,
        margin: float | None = 0.0,
        first: Index | None = None,
    ) -> Array:
        """(n,) m that surface is above each point; NaN where `supported` does not hold.

        Args:
            margin: None for surfaces as they were measured, up to `trim` beyond their true ends.
            first: (m + 1,) where groups of points begin, and n. Of a group of which one point is
                not supported, others may be NaN, too. Each point is one unless given.
        """
        keeps = 0.0 if margin is None else margin + self.trim
        above = np.ascontiguousarray(self.above(points), dtype=np.float64)
        groups = np.arange(len(points) + 1) if first is None else first
        # again after each layer that was missing, until none is
        while True:
            result, missing = _surface_gaps(above, groups, tolerance, keeps, self._stack(tolerance))
            if math.isnan(missing):
                return np.asarray(result)
            self._make([missing], tolerance)

    def ends(self, height: float, tolerance: float) -> Array:
        """(n, 2) where the surfaces about a height end, but where a thing stands.

        Args:
            height: metres, above the plane through the origin.
            tolerance: m above or below.
        """
        layer = self.layer(height, tolerance)
        if layer is None:
            return np.zeros((0, 2))
        # pixels beside an end, moved onto it along the way that it is away
        beside = (np.abs(layer.from_end) <= layer.pixel) & (layer.inside >= -layer.pixel)
        along_x, along_y = (
            np.gradient(layer.from_end, layer.pixel, axis=axis)[beside] for axis in range(2)
        )
        ways = np.column_stack([along_x, along_y])
        ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 0.5)
        at = layer.origin + np.argwhere(beside) * layer.pixel
        return np.asarray(at - layer.from_end[beside][:, None] * ways)

    def rising(
        self, touching: Array, frames: Array, low: Array, planes: Array, tolerance: float
    ) -> Mask:
        """(n,) whether some surface lies above the plane that an object stands on, and under it.

        Args:
            touching: (k, 2) points of the object that lie in its contact plane, in a frame there.
            frames: (n, 4, 4) those of the contact planes, in the world.
            low: (n,) m above each, at the origin of its frame, from which on a surface counts.
            planes: (n, 3) of which the last two are by how much more that is along the axes.
            tolerance: m above the contact plane up to which it does.
        """
        # as in `gaps`, again after each layer that was missing
        while True:
            stack = self._stack(tolerance)
            found, missing = _rising_surfaces(
                touching, frames, self.slope, low, planes, tolerance, stack
            )
            if math.isnan(missing):
                return np.asarray(found)
            self._make([missing], tolerance)

    @property
    def sparse(self) -> float:
        """`Layer.sparse` of the largest layer that there is by now; 0 without any."""
        layers = [layer for layers in self._layers.values() for layer in layers]
        return max(layers, key=lambda layer: layer.surface.size).sparse if layers else 0.0

    @cached_property
    def height_noise(self) -> float:
        """m by which noise makes heights differ, those of the points at most.

        From how heights differ from the middle between two to either side, so far away that they
        share no points.
        """
        largest = max(
            (layer for layers in self._layers.values() for layer in layers),
            key=lambda layer: layer.surface.size,
            default=None,
        )
        if self.noise == 0.0 or largest is None:
            return self.noise
        held = (largest.inside > 0.0) & np.isfinite(largest.surface)
        known = np.where(held, largest.surface, np.nan)
        # how much the surface bends over places one tile apart
        lag = round(TILE_M / largest.pixel)
        bends = [
            np.abs(along[lag:-lag] - 0.5 * (along[: -2 * lag] + along[2 * lag :])).ravel()
            for along in (known, known.T)
        ]
        found = np.concatenate(bends)
        found = found[np.isfinite(found)]
        if len(found) == 0:
            return self.noise
        # a - (b + c) / 2 deviates √1.5 times as much as one height
        deviation = 1.4826 * float(np.median(found)) / math.sqrt(1.5)
        return min(self.noise, SURE_NOISES * deviation)


def _stacked_layers(layers: list[Layer], low: int, number: Index32) -> LayerStack:
    sizes = [layer.inside.size for layer in layers]
    starts = np.cumsum([0, *sizes])[: len(layers)]
    layout = [
        (*layer.origin, layer.pixel, *layer.inside.shape, start)
        for layer, start in zip(layers, starts, strict=True)
    ]
    empty = np.zeros(0, np.float32)
    fields = (
        np.concatenate([empty, *(getattr(layer, name).ravel() for layer in layers)])
        for name in ("inside", "from_end", "surface", "top")
    )
    return LayerStack(low, number, np.array(layout).reshape(-1, 6), *fields)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def interpolated(field: Field, layout: Array, x: float, y: float) -> float:
    """Value between the four pixels around a place; -inf beside the layer.

    Args:
        layout: (6,) of the layer, see `LayerStack`.
    """
    nx, ny, start = int(layout[3]), int(layout[4]), int(layout[5])
    # in pixels, and then between four of them
    u, v = (x - layout[0]) / layout[2], (y - layout[1]) / layout[2]
    if not (0.0 <= u < nx - 1.0 and 0.0 <= v < ny - 1.0):
        return -math.inf
    i, j = int(u), int(v)
    u -= i
    v -= j
    # along y in both rows of pixels, then along x
    row = start + i * ny + j
    near = field[row] * (1.0 - v) + field[row + 1] * v
    far = field[row + ny] * (1.0 - v) + field[row + ny + 1] * v
    return float(near * (1.0 - u) + far * u)


@njit(cache=True, nogil=True)
def _surface_gaps(
    points: Array, first: Index, tolerance: float, keeps: float, stack: LayerStack
) -> tuple[Array, float]:
    """`SupportMap.gaps`, and a height whose layer must be made before; NaN where all are there."""
    result = np.full(len(points), np.nan)
    # a group ends at its first point without support
    for group in range(len(first) - 1):
        for p in range(first[group], first[group + 1]):
            x, y, z = points[p, 0], points[p, 1], points[p, 2]
            # the layer of its height, which may have to be made first
            step = round(z / LAYER_STEP_M) - stack.low
            if step < 0 or step >= len(stack.number) or stack.number[step] == NOT_MADE:
                return result, z
            number = stack.number[step]
            if number == EMPTY:
                break
            layout = stack.layout[number]
            # within the surface, and far enough from its end
            if interpolated(stack.inside, layout, x, y) < 0.0:
                break
            if keeps > 0.0 and interpolated(stack.from_end, layout, x, y) < keeps:
                break
            # and at its height
            gap = interpolated(stack.surface, layout, x, y) - z
            if not abs(gap) <= tolerance:
                break
            result[p] = gap
    return result, math.nan


@njit(cache=True, nogil=True)
def _rising_surfaces(
    touching: Array,
    frames: Array,
    slope: Slope,
    low: Array,
    planes: Array,
    tolerance: float,
    stack: LayerStack,
) -> tuple[Mask, float]:
    """`SupportMap.rising`, and a height whose layer must be made before, or NaN."""
    found = np.zeros(len(frames), np.bool_)
    for n in range(len(frames)):
        T = frames[n]
        for k in range(len(touching)):
            # where the point comes to lie, and its height above the plane of the slope
            a, b = touching[k, 0], touching[k, 1]
            x = T[0, 0] * a + T[0, 1] * b + T[0, 3]
            y = T[1, 0] * a + T[1, 1] * b + T[1, 3]
            z = T[2, 0] * a + T[2, 1] * b + T[2, 3] - slope[0] * x - slope[1] * y
            # the layer of that height, which may have to be made first
            step = round(z / LAYER_STEP_M) - stack.low
            if step < 0 or step >= len(stack.number) or stack.number[step] == NOT_MADE:
                return found, z
            if stack.number[step] == EMPTY:
                continue
            layout = stack.layout[stack.number[step]]
            # the pixel that is nearest
            i, j = round((x - layout[0]) / layout[2]), round((y - layout[1]) / layout[2])
            if not (0 <= i < layout[3] and 0 <= j < layout[4]):
                continue
            # how far the highest point around it is above
            above = stack.top[int(layout[5] + i * layout[4]) + j] - z
            # above the height from which it counts there, within the tolerance
            if low[n] + planes[n, 1] * a + planes[n, 2] * b < above <= tolerance:
                found[n] = True
                break
    return found, math.nan
