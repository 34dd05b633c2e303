"""The term aligned: along which way run the outlines of what is nearest."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from scipy.spatial import cKDTree

from placement_planner_ros.core.objective.beside import ABOVE_CONTACT_M, Beside
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.types import Array, Slope

_PLACE_DISTANCE_M = 0.018
"""m, the longest way from one place to another that counts."""
_FALLOFF_M = 0.01
"""m, what is farther than the nearest by so much counts e times less ..."""
_FALLOFF_END_M = 5.0 * _FALLOFF_M
"""m, ... and what is farther than it by so much does not count."""
_NEIGHBOURS = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
_LAYERS = (-1, 0, 1)
"""Beside a square, it goes on in one of these layers: tops are neither level nor without noise."""


class Aligned(Beside):
    """aligned: minus the angle between the longest edge of what the object stands on, or what is
    square to it, and the walls, ends of its support and things nearest to it, radians; 0 to -π/4.

    Let y be the places of their outlines seen from above, u(y) the mean of exp(4iφ) over the ways
    from y to others up to 18 mm away, φ being a way's angle and its length its weight, and a the
    longest edge's angle. With

        F = Σ w u(y),   W = Σ w,   w = exp(-(|y - m| - d) / 1 cm),

    m being the middle of what the object stands on and d the distance of the nearest y, aligned is
    -¼ arccos(Re(F exp(-4ia)) / max(|F|, W / 2)). So of straight outlines it is the angle; ways
    around a square corner cancel out; it changes steadily where another thing becomes the nearest;
    and where outlines run in all directions it is near -π/8 however the object is turned.

    Outlines are, at any height from 1 cm above the contact plane to the object's size above it, of
    all that is at that height; ends are those of `Edge`. Where there is nothing, 0.
    """

    scale: ClassVar = 0.2
    ends: ClassVar = (-0.25 * math.pi, 0.0)
    expensive: ClassVar = True

    def __init__(self, context: ObjectiveContext) -> None:
        super().__init__(context)
        faces = context.body.faces
        self._along = np.array([face.T_face_object.rotation[0] for face in faces]).reshape(-1, 3)

    def values(self, T_world_object: Array) -> Array:
        """(n,) at poses (n, 4, 4)."""
        result = np.zeros(len(T_world_object))
        for group in self._groups(T_world_object):
            # Where the side's first axis points at each pose.
            turned = T_world_object[group.rows, :2, :3]
            along = np.einsum("nij,nj->ni", turned, self._along[group.face])
            # The nearest place around, and all that are not much farther.
            nearest, _ = group.tree.query(group.middle)
            near = group.tree.query_ball_point(group.middle, nearest + _FALLOFF_END_M)
            numbers = np.array([len(places) for places in near])
            at = np.concatenate(near).astype(np.int64)
            # Weigh the places by how much farther they are than the nearest.
            away = group.tree.data[at] - np.repeat(group.middle, numbers, axis=0)
            farther = np.hypot(away[:, 0], away[:, 1]) - np.repeat(nearest, numbers)
            weighed = np.exp(-farther / _FALLOFF_M)[:, None] * group.known[at]
            x, y, most = np.add.reduceat(weighed, np.cumsum(numbers) - numbers).T
            # The angle between that axis and the weighted direction, modulo a quarter turn.
            four = 4.0 * np.arctan2(along[:, 1], along[:, 0])
            agreeing = x * np.cos(four) + y * np.sin(four)
            cosine = agreeing / np.maximum(np.hypot(x, y), 0.5 * most)
            result[group.rows] = -0.25 * np.arccos(np.clip(cosine, -1.0, 1.0))
        return result

    def _places(self, slope: Slope, height: float) -> tuple[Array, Array]:
        """Of outlines and ends, and (m, 3) their `_line_directions`."""
        # Boxes that stand higher than the contact plane and begin below the object's top.
        measured = self._environment.measured
        low, high = measured.lower, measured.upper
        middle = 0.5 * (low + high)
        plane = height + middle[:, :2] @ np.array(slope)
        beside = (high[:, 2] > plane + ABOVE_CONTACT_M) & (low[:, 2] < plane + self._size)
        # Their outlines and the ends of the support, thinned to a grid.
        outlines = _border_points(middle[beside], measured.cell_size)
        found = outlines, self._ends(slope, height)
        places = np.concatenate([_grid_means(each, measured.cell_size) for each in found])
        return _line_directions(places)


def _border_points(points: Array, cell_size: float) -> Array:
    """(m, 2) those of the points (n, 3) whose square has one without beside it in its layer of a
    grid, seen from above."""
    # Cells as keys of a grid with room around.
    cells = np.floor(points / cell_size).astype(np.int64)
    if not len(cells):
        return np.zeros((0, 2))
    cells -= cells.min(axis=0) - 1
    shape = cells.max(axis=0) + 2
    filled = np.unique(np.ravel_multi_index(tuple(cells.T), tuple(shape)))
    # A cell ends where no cell beside it is filled, in its own layer or the next ones.
    ends = np.zeros(len(cells), np.bool_)
    for i, j in _NEIGHBOURS:
        beside = [cells + np.array([i, j, k]) for k in _LAYERS]
        keys = [np.ravel_multi_index(tuple(each.T), tuple(shape)) for each in beside]
        ends |= ~np.any([np.isin(each, filled) for each in keys], axis=0)
    return np.asarray(points[ends, :2])


def _grid_means(points: Array, cell_size: float) -> Array:
    """(m, 2) means of the points (n, 2) of each square of a grid."""
    squares = np.floor(points / cell_size).astype(np.int64)
    squares, of, numbers = np.unique(squares, axis=0, return_inverse=True, return_counts=True)
    sums = np.zeros((len(squares), 2))
    np.add.at(sums, of.reshape(-1), points)
    return np.asarray(sums / numbers[:, None])


def _line_directions(places: Array) -> tuple[Array, Array]:
    """Those of places (m, 2) that have others near by, and (m, 3) the means of cos 4φ and sin 4φ
    over the ways there, longer ones counting more, and 1."""
    # Pairs of places that are near each other, and the directions between them.
    pairs = cKDTree(places).query_pairs(_PLACE_DISTANCE_M, output_type="ndarray").reshape(-1, 2)
    x, y = (places[pairs[:, 1]] - places[pairs[:, 0]]).T
    length, four = np.hypot(x, y), 4.0 * np.arctan2(y, x)
    each = np.column_stack([length * np.cos(four), length * np.sin(four), length])
    # Add to both places of each pair.
    sums = np.zeros((len(places), 3))
    for end in (0, 1):
        np.add.at(sums, pairs[:, end], each)
    shown = sums[:, 2] > 0.0
    return places[shown], sums[shown] / sums[shown, 2:]
