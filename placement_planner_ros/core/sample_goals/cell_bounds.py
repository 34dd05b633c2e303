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
from placement_planner_ros.core.search.cell_layout import ANGLE, FACE, SLOPE, X, Y, Z, contacts
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.types import Array, TargetVolume, upright

Mask = npt.NDArray[np.bool_]

_REACH_SLACK = 1e-3
"""m, more than inverse kinematics leaves open."""
_ROUNDING = 1e-6
"""m, more than arithmetic is off by, and than surfaces reach beyond their edges."""
_SAME_HEIGHT = 1e-3
"""m: surfaces for contact heights closer together than this are looked up in one table."""


class _Placed:
    """Where cells (n, 10) put points of the body.

    A pose of a cell is T(R_n R_z(θ), c) · fT_o, so a point p of the face frame comes to lie within
    `turn` ‖p_xy‖ + the box of c about its place at the middle of the cell. The turn is about the
    normal of the cell's plane, and c lies in it: upwards they make less than `steep` of that.
    """

    def __init__(self, cells: Array) -> None:
        self.face = cells[:, FACE].astype(np.int64)
        self.half = 0.5 * np.column_stack(
            [cells[:, X + 1] - cells[:, X], cells[:, Y + 1] - cells[:, Y]]
        )
        middle = np.column_stack([cells[:, X], cells[:, Y]]) + self.half
        self.contact = contacts(cells, middle)
        self.height = cells[:, Z]
        self.slope = cells[:, [SLOPE, SLOPE + 1]]
        angle = 0.5 * (cells[:, ANGLE] + cells[:, ANGLE + 1])
        half_angle = np.minimum(0.5 * (cells[:, ANGLE + 1] - cells[:, ANGLE]), np.pi)
        cos, sin = np.cos(angle), np.sin(angle)
        self._turned = np.zeros((len(cells), 3, 3))
        self._turned[:, 0, 0] = self._turned[:, 1, 1] = cos
        self._turned[:, 1, 0], self._turned[:, 0, 1] = sin, -sin
        self._turned[:, 2, 2] = 1.0
        if self.slope.any():
            self._turned = upright(self.slope) @ self._turned
        # how far a point at distance 1 from the normal through c is from its middle at most
        self.turn = 2.0 * np.sin(0.5 * half_angle)
        self.rise = (np.abs(self.slope) * self.half).sum(axis=1)
        rises = np.hypot(self.slope[:, 0], self.slope[:, 1])
        self.steep = rises / np.sqrt(1.0 + rises * rises)

    def middles(self, points: Array) -> Array:
        """(n, m, 3) points (n, m, 3) of the face frame at the middle of each cell."""
        turned = points @ self._turned.transpose(0, 2, 1)
        return np.asarray(turned + self.contact[:, None])

    def strays(self, points: Array) -> Array:
        """(n, m) m, how far turning takes each point from there at most."""
        return np.asarray(self.turn[:, None] * np.hypot(points[..., 0], points[..., 1]))

    def rises(self, points: Array) -> Array:
        """(n, m) m, how far up or down each point gets from there at most."""
        return np.asarray(self.rise[:, None] + self.steep[:, None] * self.strays(points))


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
        away = np.abs(placed.middles(wrists) - self._shoulders)
        aside = np.maximum(away[..., :2] - placed.half[:, None], 0.0)
        distance = np.maximum(np.hypot(aside[..., 0], aside[..., 1]) - placed.strays(wrists), 0.0)
        height = np.maximum(away[..., 2] - placed.rises(wrists), 0.0)
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
        feet = []
        for face in body.faces:
            T = face.T_face_object
            feet.append((face.vertices @ T.rotation.T + T.translation)[:, :2])
        most = max((len(points) for points in feet), default=0)
        # padded with the reference vertex, so that all faces have as many; on the plane, z is 0
        self._contacts = np.zeros((len(feet), most, 3))
        for padded, points in zip(self._contacts, feet, strict=True):
            padded[: len(points), :2] = points
            padded[len(points) :, :2] = points[0]
        self._centers = np.array([f.T_face_object.act(body.center_of_mass) for f in body.faces])
        self._centers = self._centers.reshape(-1, 1, 3)
        # only columns that a body standing in V can reach
        size = float(np.linalg.norm(np.ptp(body.vertices, axis=0)))
        corners = np.array([volume.lower[:2] - size, volume.upper[:2] + size])
        first, last = _columns(support, corners)
        self._origin = support.origin[:2] + first * support.cell_size
        self._cell_size = support.cell_size
        self._shape = np.maximum(last - first + 1, 0)
        self._tables = {}
        for slope in {region.slope for region in environment.regions}:
            heights = np.array([r.z for r in environment.regions if r.slope == slope])
            levels = np.unique(np.round(heights / _SAME_HEIGHT))
            sums = self._summed(environment.support_of(slope), levels, first, poses)
            self._tables[slope] = levels, sums

    def _summed(
        self,
        support: SupportMap,
        levels: Array,
        first: npt.NDArray[np.int64],
        poses: PoseConstraints,
    ) -> Array:
        """(levels, nx + 1, ny + 1) columns with a roomy surface at that height, summed up."""
        off = 0.51 * _SAME_HEIGHT
        column = np.repeat(np.arange(len(support.start) - 1), np.diff(support.start))
        i, j = np.array(np.divmod(column, support.columns[1])) - first[:, None]
        nx, ny = self._shape
        near = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
        i, j = i[near], j[near]
        sums = np.zeros((len(levels), nx + 1, ny + 1), dtype=np.int32)
        for table, level in zip(sums, levels, strict=True):
            at = support.roomy(
                level * _SAME_HEIGHT, poses.contact_tolerance, poses.edge_margin, off
            )[near]
            table[i[at] + 1, j[at] + 1] = 1
        return np.asarray(sums.cumsum(axis=1, dtype=np.int32).cumsum(axis=2, dtype=np.int32))

    def unsupported(self, placed: _Placed) -> Mask:
        """(n,) cells at all of whose poses something lacks support, or the centre of mass V."""
        feet = self._contacts[placed.face]
        middles = placed.middles(feet)[..., :2]
        within = placed.half[:, None] + placed.strays(feet)[..., None] + _ROUNDING
        low = np.floor((middles - within - self._origin) / self._cell_size).astype(np.int64)
        high = np.floor((middles + within - self._origin) / self._cell_size).astype(np.int64) + 1
        low, high = np.clip(low, 0, self._shape), np.clip(high, 0, self._shape)
        i0, j0, i1, j1 = low[..., 0], low[..., 1], high[..., 0], high[..., 1]
        surfaces = np.zeros(i0.shape, dtype=np.int64)
        for slope, (levels, sums) in self._tables.items():
            of = (placed.slope == slope).all(axis=1)
            level = np.searchsorted(levels, np.round(placed.height[of] / _SAME_HEIGHT))[:, None]
            a, b, c, d = i0[of], j0[of], i1[of], j1[of]
            surfaces[of] = sums[level, c, d] - sums[level, a, d] - sums[level, c, b]
            surfaces[of] += sums[level, a, b]
        centers = self._centers[placed.face]
        middle = placed.middles(centers)[:, 0, :2]
        within = placed.half + placed.strays(centers) + _ROUNDING
        heights = placed.contact[:, 2], placed.rise + _ROUNDING
        outside = _beside(self._volume, middle, within, *heights)
        return np.asarray((surfaces == 0).any(axis=1) | outside)


def _beside(volume: TargetVolume, middle: Array, within: Array, height: Array, rise: Array) -> Mask:
    """(n,) whether no point within a square of half sides (n, 2), and within a rise (n,) of a
    height (n,), lies in V."""
    beside = np.ones(len(middle), np.bool_)
    for lower, upper in volume.joined:
        away = (middle + within < lower[:2]) | (middle - within > upper[:2])
        apart = (height + rise < lower[2]) | (height - rise > upper[2])
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
        """(n,) `Ruling` of each of the (n, 10) cells."""
        placed = _Placed(cells)
        result = np.full(len(cells), Ruling.OPEN, dtype=np.int64)
        result[self._support.unsupported(placed)] = Ruling.UNSUPPORTED
        result[self._reach.out_of_reach(placed)] = Ruling.OUT_OF_REACH
        return result

    def beyond_reach(self, cells: Array) -> Array:
        """(n, holdings) m, how much each arm lacks at least to get to any pose of cells (n, 10); 0
        or less where nothing is known to be lacking."""
        return self._reach.beyond(_Placed(cells))
