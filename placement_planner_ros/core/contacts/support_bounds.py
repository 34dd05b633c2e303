"""Cells of Ŝ(r, f) that provably leave the object without support, or beside V.

How far a place is from where support begins tells it for all that are nearer to it than that.
"""

from __future__ import annotations

import math

import numpy as np

from placement_planner_ros.core.contacts.by_polygon import PolygonSupport
from placement_planner_ros.core.contacts.by_vertices import VertexSupport
from placement_planner_ros.core.contacts.placed_cells import PlacedCells
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.layers import LAYER_STEP_M
from placement_planner_ros.core.types import SINGLE_ROUNDING, Array, Mask, Slope, TargetVolume

_BETWEEN_PIXELS = 2.5
"""Pixels of a layer that a value between four of them differs from the nearest at most, beside what
the distance explains."""
_SIDES = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
_SPACING = 0.25
"""Radii between the places that a disc is looked at."""
_DISC = np.mgrid[-1 : 1 + _SPACING : _SPACING, -1 : 1 + _SPACING : _SPACING].reshape(2, -1).T
_DISC_REACH = _SPACING / math.sqrt(2.0)
"""Radii that no place of the square around the disc is farther from one of these."""


class SupportBound:
    """Whether what carries the object may be there, and the centre of mass in V.

    Args:
        problem: its body has the faces that are judged.
        support, footing: s(x) of these.
    """

    def __init__(
        self, problem: Problem, support: VertexSupport | PolygonSupport, footing: SupportSettings
    ) -> None:
        body = problem.body
        self._environment = problem.environment
        self._volume = problem.volume
        self._tolerance = footing.contact_tolerance
        self._polygon = support if isinstance(support, PolygonSupport) else None
        self._margin = None if self._polygon else footing.edge_margin
        self._centers = np.array([f.T_face_object.act(body.center_of_mass) for f in body.faces])
        self._centers = self._centers.reshape(-1, 1, 3)
        # The corners of each face about the contact point, on its plane.
        feet = [
            (f.vertices @ f.T_face_object.rotation.T + f.T_face_object.translation)[:, :2]
            for f in body.faces
        ]
        # padded with the first, so that all faces have as many
        self._feet = np.zeros((len(feet), max((len(each) for each in feet), default=0), 3))
        for padded, points in zip(self._feet, feet, strict=True):
            padded[:, :2] = points[0]
            padded[: len(points), :2] = points
        self._fields: dict[tuple[float, ...], list[tuple[Array, float, Array]]] = {}  # by plane

    def unsupported(self, placed: PlacedCells) -> Mask:
        """(n,) cells at all of whose poses support is lacking, or the centre of mass beside V."""
        # Whether the centre of mass can lie in V.
        centers = self._centers[placed.face]
        middle = placed.middles(centers)[:, 0, :2]
        within = placed.half + placed.strays(centers) + SINGLE_ROUNDING
        heights = placed.contact[:, 2], placed.rise + SINGLE_ROUNDING
        outside = _beside_volume(self._volume, middle, within, *heights)
        stands = self._carried if self._polygon is None else self._surrounded
        return np.asarray(outside | ~stands(placed))

    def _carried(self, placed: PlacedCells) -> Mask:
        """(n,) cells in which every vertex of v(f) may find support in the disc it stays in."""
        feet = self._feet[placed.face]
        found = self._supported(placed, placed.middles(feet)[..., :2], placed.strays(feet))
        return np.asarray(found.all(axis=1))

    def _surrounded(self, placed: PlacedCells) -> Mask:
        """(n,) cells in which what touches may find support ahead, behind, left and right of the
        centre of mass, as far from it as the hull of what carries must reach."""
        assert self._polygon is not None
        shift, inside = self._polygon.least_inside(placed.face, placed.slope)
        radius = self._polygon.radii[placed.face, None]
        # Places all over a square around the contact point.
        at, within = radius[..., None] * _DISC, np.repeat(_DISC_REACH * radius, len(_DISC), axis=1)
        found = self._supported(placed, placed.contact[:, None, :2] + at, within)
        away = shift @ _SIDES.T + inside[:, None] - within[:, :1] - SINGLE_ROUNDING
        beyond = at @ _SIDES.T >= away[:, None]
        return np.asarray((found[..., None] & beyond).any(axis=1).all(axis=1))

    def _supported(self, placed: PlacedCells, middles: Array, radii: Array) -> Mask:
        """(n, m) whether there may be support in discs that move with the cells, at their heights.

        Args:
            middles, radii: (n, m, 2) and (n, m) of the discs, at the middle of each cell.
        """
        # Support may be as far from the middle as disc and cell reach.
        radii = radii + np.linalg.norm(placed.half, axis=1)[:, None] + SINGLE_ROUNDING
        found = np.zeros(radii.shape, np.bool_)
        # Cells on one plane are looked up together.
        for number in np.unique(placed.plane).tolist():
            plane = height, along_x, along_y = tuple(placed.planes[number].tolist())
            if plane not in self._fields:
                self._fields[plane] = self._fields_at(height, (along_x, along_y))
            rows = np.flatnonzero(placed.plane == number)
            for origin, pixel, field in self._fields[plane]:
                # At the pixel of the layer that is nearest to the middle.
                at = np.round((middles[rows] - origin) / pixel).astype(np.int64)
                i, j = np.moveaxis(at.clip(0, np.array(field.shape) - 1), -1, 0)
                found[rows] |= field[i, j] + radii[rows] + _BETWEEN_PIXELS * pixel >= 0.0
        return found

    def _fields_at(self, height: float, slope: Slope) -> list[tuple[Array, float, Array]]:
        """Of the layers that answer for a height: origin, pixel, and (nx, ny) how deep inside of
        the support a pixel is, negative by how far it is beside."""
        support, fields = self._environment.support_of(slope), []
        ends = (round((height + off) / LAYER_STEP_M) for off in (-SINGLE_ROUNDING, SINGLE_ROUNDING))
        for step in sorted(set(ends)):
            layer = support.layer(step * LAYER_STEP_M, self._tolerance)
            if layer is None:
                continue
            inside = layer.inside.astype(np.float64)
            # What keeps a margin is that much less deep inside.
            if self._margin is not None and (keeps := self._margin + support.trim) > 0.0:
                inside = np.minimum(inside, layer.from_end - keeps)
            fields.append((layer.origin, layer.pixel, inside))
        return fields


def _beside_volume(
    volume: TargetVolume, middle: Array, within: Array, height: Array, rise: Array
) -> Mask:
    """(n,) whether no point within a square of half sides (n, 2), and within a rise (n,) of a
    height (n,), lies in V."""
    beside = np.ones(len(middle), np.bool_)
    # Beside or above or below every box of V.
    for lower, upper in volume.boxes:
        away = (middle + within < lower[:2]) | (middle - within > upper[:2])
        apart = (height + rise < lower[2]) | (height - rise > upper[2])
        beside &= away.any(axis=1) | apart
    return beside
