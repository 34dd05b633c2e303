"""Which cells of the pose sets Ŝ(r, f) provably hold no placement."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.reach.reach_bound import ReachBound
from placement_planner_ros.core.scene.support import SupportMap
from placement_planner_ros.core.search.cell_layout import ANGLE, FACE, X, Y, Z
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.types import Array, TargetVolume

Mask = npt.NDArray[np.bool_]

_REACH_SLACK = 1e-3
"""m, more than inverse kinematics leaves open."""
_ROUNDING = 1e-6
"""m, more than arithmetic is off by, and than surfaces reach beyond their edges."""
_SAME_HEIGHT = 1e-3
"""m: surfaces for contact heights closer together than this are looked up in one table."""


class _Placed:
    """Where cells (n, 8) put points of the body.

    A pose of a cell is T(R_z(θ), c) · fT_o, so a point p of the face frame comes to lie within
    `turn` ‖p_xy‖ + the box of c about its place at the middle of the cell.
    """

    def __init__(self, cells: Array) -> None:
        self.face = cells[:, FACE].astype(np.int64)
        self.half = 0.5 * np.column_stack(
            [cells[:, X + 1] - cells[:, X], cells[:, Y + 1] - cells[:, Y]]
        )
        self.contact = np.column_stack([cells[:, X], cells[:, Y], cells[:, Z]])
        self.contact[:, :2] += self.half
        angle = 0.5 * (cells[:, ANGLE] + cells[:, ANGLE + 1])
        half_angle = np.minimum(0.5 * (cells[:, ANGLE + 1] - cells[:, ANGLE]), np.pi)
        self.cos, self.sin = np.cos(angle), np.sin(angle)
        # how far a point at distance 1 from the vertical through c is from its middle at most
        self.turn = 2.0 * np.sin(0.5 * half_angle)

    def middles(self, points: Array) -> Array:
        """(n, m, 2) x and y of points (n, m, >= 2) of the face frame at the middle of each cell."""
        x, y = points[..., 0], points[..., 1]
        cos, sin = self.cos[:, None], self.sin[:, None]
        turned = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
        return np.asarray(turned + self.contact[:, None, :2])

    def strays(self, points: Array) -> Array:
        """(n, m) m, how far turning takes each point from there at most, in the plane."""
        return np.asarray(self.turn[:, None] * np.hypot(points[..., 0], points[..., 1]))


class _Reach:
    """Whether any arm is long enough: how far its wrist gets from its shoulder is bounded."""

    def __init__(self, body: Body, holdings: Iterable[Holding]) -> None:
        bounds, in_object = [], []
        for holding in holdings:
            bound = ReachBound.of(holding.chain)
            bounds.append(bound)
            in_object.append(holding.arm.grasps[holding.grasp].actInv(bound.wrist))
        wrists = np.array(in_object).reshape(-1, 3)
        self._shoulders = np.array([bound.shoulder for bound in bounds]).reshape(-1, 3)
        self._lengths = np.array([bound.length for bound in bounds])
        self._wrists = np.array(
            [wrists @ f.T_face_object.rotation.T + f.T_face_object.translation for f in body.faces]
        ).reshape(len(body.faces), len(wrists), 3)

    def out_of_reach(self, placed: _Placed) -> Mask:
        """(n,) cells at none of whose poses any wrist is where its arm can bring it."""
        return np.asarray((self.beyond(placed) > _REACH_SLACK).all(axis=1))

    def beyond(self, placed: _Placed) -> Array:
        """(n, holdings) m, how far beyond its arm's length each wrist is at all poses at least."""
        wrists = self._wrists[placed.face]
        aside = np.abs(placed.middles(wrists) - self._shoulders[:, :2]) - placed.half[:, None]
        aside = np.maximum(aside, 0.0)
        distance = np.maximum(np.hypot(aside[..., 0], aside[..., 1]) - placed.strays(wrists), 0.0)
        height = wrists[..., 2] + placed.contact[:, None, 2] - self._shoulders[:, 2]
        return np.asarray(np.hypot(distance, height) - self._lengths)


class _Support:
    """Whether every vertex of v(f) may find support, and the centre of mass V.

    A cell is ruled out where the rectangle that a vertex stays in holds no column of the support
    map with a surface at the contact height that is `roomy` enough for the edge margin. Tables of
    sums answer that in constant time.
    """

    def __init__(
        self,
        poses: PoseConstraints,
    ) -> None:
        body, environment = poses.problem.body, poses.problem.environment
        volume = poses.problem.volume
        support = environment.support
        self._volume = volume
        contacts = []
        for face in body.faces:
            T = face.T_face_object
            contacts.append((face.vertices @ T.rotation.T + T.translation)[:, :2])
        most = max((len(points) for points in contacts), default=0)
        # padded with the reference vertex, so that all faces have as many
        self._contacts = np.zeros((len(contacts), most, 2))
        for padded, points in zip(self._contacts, contacts, strict=True):
            padded[: len(points)] = points
            padded[len(points) :] = points[0]
        self._centers = np.array([f.T_face_object.act(body.center_of_mass) for f in body.faces])
        self._centers = self._centers.reshape(-1, 1, 3)
        # only columns that a body standing in V can reach
        size = float(np.linalg.norm(np.ptp(body.vertices, axis=0)))
        corners = np.array([volume.lower[:2] - size, volume.upper[:2] + size])
        first, last = _columns(support, corners)
        self._origin = support.origin[:2] + first * support.cell_size
        self._cell_size = support.cell_size
        self._shape = np.maximum(last - first + 1, 0)
        heights = np.round(np.array([r.z for r in environment.regions]) / _SAME_HEIGHT)
        self._levels = np.unique(heights)
        self._sums = self._tables(support, first, poses)

    def _tables(
        self, support: SupportMap, first: npt.NDArray[np.int64], poses: PoseConstraints
    ) -> Array:
        """(levels, nx + 1, ny + 1) columns with a roomy surface at that height, summed up."""
        off = 0.51 * _SAME_HEIGHT
        column = np.repeat(np.arange(len(support.start) - 1), np.diff(support.start))
        i, j = np.array(np.divmod(column, support.columns[1])) - first[:, None]
        nx, ny = self._shape
        near = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
        i, j = i[near], j[near]
        sums = np.zeros((len(self._levels), nx + 1, ny + 1), dtype=np.int32)
        for table, level in zip(sums, self._levels, strict=True):
            at = support.roomy(
                level * _SAME_HEIGHT, poses.contact_tolerance, poses.edge_margin, off
            )[near]
            table[i[at] + 1, j[at] + 1] = 1
        return np.asarray(sums.cumsum(axis=1, dtype=np.int32).cumsum(axis=2, dtype=np.int32))

    def unsupported(self, placed: _Placed) -> Mask:
        """(n,) cells at all of whose poses something lacks support, or the centre of mass V."""
        contacts = self._contacts[placed.face]
        middles = placed.middles(contacts)
        within = placed.half[:, None] + placed.strays(contacts)[..., None] + _ROUNDING
        low = np.floor((middles - within - self._origin) / self._cell_size).astype(np.int64)
        high = np.floor((middles + within - self._origin) / self._cell_size).astype(np.int64) + 1
        low, high = np.clip(low, 0, self._shape), np.clip(high, 0, self._shape)
        level = np.searchsorted(self._levels, np.round(placed.contact[:, 2] / _SAME_HEIGHT))
        level = level[:, None]
        i0, j0, i1, j1 = low[..., 0], low[..., 1], high[..., 0], high[..., 1]
        sums = self._sums
        surfaces = sums[level, i1, j1] - sums[level, i0, j1] - sums[level, i1, j0]
        surfaces += sums[level, i0, j0]
        centers = self._centers[placed.face]
        middle = placed.middles(centers)[:, 0]
        within = placed.half + placed.strays(centers) + _ROUNDING
        outside = _beside(self._volume, middle, within, placed.contact[:, 2])
        return np.asarray((surfaces == 0).any(axis=1) | outside)


def _beside(volume: TargetVolume, middle: Array, within: Array, height: Array) -> Mask:
    """(n,) whether no point at (n,) heights and within a square of half sides (n, 2) lies in V."""
    beside = np.ones(len(middle), np.bool_)
    for lower, upper in volume.joined:
        away = (middle + within < lower[:2]) | (middle - within > upper[:2])
        apart = (height + _ROUNDING < lower[2]) | (height - _ROUNDING > upper[2])
        beside &= away.any(axis=1) | apart
    return beside


def _columns(
    support: SupportMap, corners: Array
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """First and last column (i, j) of the map between two corners (2, 2)."""
    at = np.floor((corners - support.origin[:2]) / support.cell_size).astype(np.int64)
    first, last = np.clip(at, 0, np.array(support.columns) - 1)
    return first, last


class BranchBounds:
    """`CellBounds` of one problem: reach and support.

    Args:
        poses: s(x), of one problem.
        holdings: every arm with every grasp that may be used.
    """

    def __init__(
        self,
        poses: PoseConstraints,
        holdings: Iterable[Holding],
    ) -> None:
        self._reach = _Reach(poses.problem.body, holdings)
        self._support = _Support(poses)

    def rulings(self, cells: Array) -> npt.NDArray[np.int64]:
        """(n,) `Ruling` of each of the (n, 8) cells."""
        placed = _Placed(cells)
        result = np.full(len(cells), Ruling.OPEN, dtype=np.int64)
        result[self._support.unsupported(placed)] = Ruling.UNSUPPORTED
        result[self._reach.out_of_reach(placed)] = Ruling.OUT_OF_REACH
        return result

    def beyond_reach(self, cells: Array) -> Array:
        """(n, holdings) m, how much each arm lacks at least to get to any pose of the cells (n, 8);
        0 or less where nothing is known to be lacking."""
        return self._reach.beyond(_Placed(cells))
