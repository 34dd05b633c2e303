"""The clearance objective over the regions in colours, estimated from what the node publishes.

C(x) is the mean distance from the object's points to what stands around, sideways and upwards, at
most 0.5 m; what ends below a point does not count for it. The node publishes the middles of its
obstacles' cells only, and the page knows the object's hull only, so that the estimate is off by a
cell or so. It is for looking at; the planner never sees it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.ndimage import distance_transform_edt
from scipy.spatial import ConvexHull, Delaunay, QhullError

from placement_planner_ros.core.types import Array
from placement_planner_ros.view import colours
from placement_planner_ros.view.record import Improvement
from placement_planner_ros.view.world import Itself, Surface, World, pose_of

CAP = 0.5
"""m, the greatest distance that counts."""
LEVELS = 6
"""Heights of the object at which distances are taken."""
_POINTS = 160
_SQUARE = 0.02
"""m, the side of the squares for each of which one distance is taken."""
AGREES = 0.05
"""m by which the estimate and ξ as published may differ for the estimate to be shown."""
_KNOWN = {"maximize_clearance", "minimize_clearance"}
"""Objectives that are estimated."""


def inner_points(vertices: Array) -> Array:
    """(n, 3) points spread over the hull of an object's vertices (m, 3)."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    drawn = low + np.random.default_rng(0).random((8 * _POINTS, 3)) * (high - low)
    try:
        inside = drawn[Delaunay(vertices[ConvexHull(vertices).vertices]).find_simplex(drawn) >= 0]
    except QhullError:  # flat
        return np.asarray(vertices)
    return np.asarray(inside[:_POINTS] if len(inside) >= 20 else vertices)


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleLayers:
    """How far away, in the plane, what counts as obstacle is in each layer of its cells.

    Made once for an obstacle set; a distance at a height is the least over the layers above it.

    Attributes:
        middles: (l,) heights of the layers' middles, metres, upwards.
        squared: (l, x, y) squares of distances in the plane, m², for squares of `_SQUARE`.
        corner: (2,) the first square's middle, metres.
        cell_size: the cells' side, metres.
    """

    middles: Array
    squared: npt.NDArray[np.float32]
    corner: Array
    cell_size: float

    @classmethod
    def of(cls, cells: Array, cell_size: float, boxes: Array, beyond: float) -> ObstacleLayers:
        """Of the cells that count.

        Args:
            cells: (n, 3) middles of the obstacles' cells.
            boxes: (k, 2, 3) V.
            beyond: metres outside of V up to which cells count.
        """
        near = np.zeros(len(cells), bool)
        for lower, upper in boxes:
            near |= ((cells >= lower - beyond) & (cells <= upper + beyond)).all(axis=1)
        cells = cells[near]
        corner = boxes[:, 0, :2].min(axis=0) - CAP
        count = np.ceil((boxes[:, 1, :2].max(axis=0) + CAP - corner) / _SQUARE).astype(int) + 1
        layer = np.rint(cells[:, 2] / cell_size).astype(int)
        numbers = np.unique(layer)
        squared = np.full((len(numbers), *count), CAP**2, np.float32)
        square = np.clip(np.rint((cells[:, :2] - corner) / _SQUARE).astype(int), 0, count - 1)
        for k, number in enumerate(numbers):
            free = np.ones(count, bool)
            free[tuple(square[layer == number].T)] = False
            away = _SQUARE * distance_transform_edt(free) - 0.5 * cell_size
            squared[k] = np.clip(away, 0.0, CAP) ** 2
        return cls(numbers * cell_size, squared, corner, cell_size)

    def distances(self, xy: Array, height: float, support: float) -> Array:
        """(n,) distances at xy (n, 2) and that height, of what is on a surface of that support."""
        half = 0.5 * self.cell_size
        first = np.searchsorted(self.middles, max(height - half, support + self.cell_size), "right")
        # As boxes are flat to whoever is beside them, only what begins above counts upwards.
        up = np.maximum(self.middles[first:] - half - height, 0.0)
        up = up[up < CAP]
        if len(up) == 0:
            return np.full(len(xy), CAP)
        i, j = self._square(xy, 0), self._square(xy, 1)
        low, high = (i.min(), j.min()), (i.max() + 1, j.max() + 1)
        window = self.squared[first : first + len(up), low[0] : high[0], low[1] : high[1]]
        nearest = (window + (up**2).astype(np.float32)[:, None, None]).min(axis=0)
        return np.minimum(np.sqrt(nearest), CAP)[i - low[0], j - low[1]]

    def _square(self, xy: Array, axis: int) -> npt.NDArray[np.int32]:
        """(n,) numbers of the squares that places (n, 2) are in, along one axis."""
        number = ((xy[:, axis] - self.corner[axis]) * (1.0 / _SQUARE) + 0.5).astype(np.int32)
        return np.clip(number, 0, self.squared.shape[1 + axis] - 1)


def estimated_clearance(
    places: Array, T_world_object: pin.SE3, points: Array, layers: ObstacleLayers
) -> Array:
    """(n,) C, metres, of the object moved to each of the places without turning.

    Args:
        places: (n, 3) on surfaces; the object's middle comes to be above them.
        points: (m, 3) spread over the object, in its frame.
    """
    turned = points @ T_world_object.rotation.T
    turned -= [*turned[:, :2].mean(axis=0), turned[:, 2].min()]
    values = np.full(len(places), CAP)
    steps = np.linspace(0.0, turned[:, 2].max() + 1e-9, LEVELS + 1)
    level = np.clip(np.searchsorted(steps, turned[:, 2], side="right") - 1, 0, LEVELS - 1)
    for rows, support in _by_height(places):
        total = np.zeros(len(rows))
        for k in range(LEVELS):
            here = turned[level == k, :2]
            if len(here) == 0:
                continue
            height = support + 0.5 * (steps[k] + steps[k + 1])
            xy = (places[rows, None, :2] + here).reshape(-1, 2)
            distances = layers.distances(xy, height, support)
            total += distances.reshape(len(rows), len(here)).sum(axis=1)
        values[rows] = total / len(turned)
    return values


def _by_height(places: Array) -> Iterator[tuple[npt.NDArray[np.int64], float]]:
    """Those at one height, to a centimetre, and how high that is."""
    heights = np.round(places[:, 2], 2)
    for height in np.unique(heights):
        rows = np.flatnonzero(heights == height).astype(np.int64)
        yield rows, float(np.median(places[rows, 2]))


def sign_that_agrees(estimate: float, objective: float) -> int:
    """1 where ξ is C, -1 where it is -C, by what is published of one placement; 0 where neither."""
    for sign in (1, -1):
        if abs(sign * estimate - objective) <= AGREES:
            return sign
    return 0


class RegionColours:
    """Estimates the clearance objective over the regions.

    Attributes:
        ends: the least and the greatest ξ of the newest estimate; None where there is none.
    """

    def __init__(self) -> None:
        self.ends: tuple[float, float] | None = None
        self._inner: tuple[Array, Array] = (np.zeros((0, 3)), np.zeros((0, 3)))
        self._layers: tuple[object, ObstacleLayers] | None = None

    def of(
        self,
        pieces: Array,
        best: Improvement | None,
        surface: Surface | None,
        obstacles: Array,
        volume: Array,
        world: World,
    ) -> npt.NDArray[np.uint8] | None:
        """(n, 3) colours of the pieces (n, 4, 3), the object being turned as in the best placement.

        None where another objective is sought, or what is estimated of the best placement is not
        what the node says of it.
        """
        self.ends = None
        if best is None or surface is None or best.solution.terms:
            return None
        if len(pieces) == 0 or len(volume) == 0:
            return None
        if world.parameter("objective", "") not in _KNOWN:
            return None
        T = pose_of(best.solution.pose.pose)
        if self._inner[0] is not surface[0]:
            self._inner = surface[0], inner_points(surface[0])
        points = self._inner[1]
        beyond = CAP if world.parameter("clearance.beyond_volume", True) else 0.0
        size = float(world.parameter("cloud.cell_size", 0.01))
        key = (Itself(obstacles), volume.tobytes(), size, beyond)
        if self._layers is None or self._layers[0] != key:
            self._layers = key, ObstacleLayers.of(obstacles, size, volume, beyond)
        places = np.vstack([pieces.mean(axis=1), _foot(surface[0], points, T)])
        values = estimated_clearance(places, T, points, self._layers[1])
        sign = sign_that_agrees(float(values[-1]), best.solution.objective)
        if sign == 0:
            return None
        values = sign * values[:-1]
        low, high = float(values.min()), float(values.max())
        self.ends = low, high
        return colours.scale((values - low) / max(high - low, 1e-6))


def _foot(vertices: Array, points: Array, T: pin.SE3) -> Array:
    """(1, 3) below the middle of the object at T, where it stands."""
    placed = vertices @ T.rotation.T + T.translation
    inside = points @ T.rotation.T + T.translation
    return np.array([[*inside[:, :2].mean(axis=0), placed[:, 2].min()]])
