"""Cells of the pose sets Ŝ(r, f) that provably hold no placement."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.objective.objective import Objective, PoseRanges, SlowObjective
from placement_planner_ros.core.reach.reach_bound import ReachBound
from placement_planner_ros.core.sample_goals.overlap_bounds import OverlapBound
from placement_planner_ros.core.sample_goals.placed_cells import PlacedCells
from placement_planner_ros.core.sample_goals.required_bounds import RequiredBound
from placement_planner_ros.core.sample_goals.support_bounds import SupportBound
from placement_planner_ros.core.search.cell_layout import PoseSets
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.types import Array

Mask = npt.NDArray[np.bool_]

_REACH_SLACK_M = 1e-3
"""m, more than inverse kinematics leaves open."""
_ROUNDING = 1e-9
"""More than arithmetic is off by, in units of ξ."""


class _Reach:
    """Whether any arm is long enough: how far its wrist gets from its shoulder is bounded."""

    def __init__(self, body: Body, holdings: Iterable[Holding]) -> None:
        # Each arm's bound, with its wrist in the frame of the object.
        bounds, in_object = [], []
        for holding in holdings:
            bound = ReachBound.of(holding.chain)
            bounds.append(bound)
            in_object.append(holding.arm.grasps[holding.grasp].actInv(bound.wrist))
        wrists = np.array(in_object).reshape(-1, 3)
        self._shoulders = np.array([bound.shoulder for bound in bounds]).reshape(-1, 3)
        self._lengths = np.array([bound.length for bound in bounds])
        # The wrists in the frame of each face.
        self._wrists = np.array(
            [wrists @ f.T_face_object.rotation.T + f.T_face_object.translation for f in body.faces]
        ).reshape(len(body.faces), len(wrists), 3)

    def out_of_reach(self, placed: PlacedCells) -> Mask:
        """(n,) cells at none of whose poses any wrist is where its arm can bring it."""
        return np.asarray((self.beyond(placed) > _REACH_SLACK_M).all(axis=1))

    def beyond(self, placed: PlacedCells) -> Array:
        """(n, holdings) m, how far beyond its arm's length each wrist is at all poses at least."""
        wrists = self._wrists[placed.face]
        away = np.abs(placed.middles(wrists) - self._shoulders)
        aside = np.maximum(away[..., :2] - placed.half[:, None], 0.0)
        distance = np.maximum(np.hypot(aside[..., 0], aside[..., 1]) - placed.strays(wrists), 0.0)
        height = np.maximum(away[..., 2] - placed.rises(wrists), 0.0)
        return np.asarray(np.hypot(distance, height) - self._lengths)


class BranchBounds:
    """`CellBounds` of one problem: reach, support, what is required, and ξ.

    Args:
        poses: s(x) and what is required, of one problem.
        holdings: every arm with every grasp that may be used.
        sets: what the cells are of.
        objective: ξ.

    Attributes:
        required: what of required terms is known of whole cells.
        bounded: whether anything is known of ξ.
        turn_radius: m that one radian counts as: half the size of the object.
    """

    def __init__(
        self,
        poses: PoseConstraints,
        holdings: Iterable[Holding],
        sets: PoseSets,
        objective: Objective,
    ) -> None:
        self._sets = sets
        self._poses, self._objective = poses, objective
        self._reach = _Reach(poses.problem.body, holdings)
        faces = poses.problem.body.faces
        self._T_face_object = np.array([f.T_face_object.homogeneous for f in faces])
        self.required = RequiredBound(poses)
        size = np.ptp(poses.problem.body.vertices, axis=0)
        self.turn_radius = 0.5 * float(np.linalg.norm(size))
        self.bounded = isinstance(objective, SlowObjective) and objective.bounded

    @cached_property
    def _support(self) -> SupportBound:
        """Made once it is asked for: the first placement is often found before."""
        return SupportBound(self._poses)

    @cached_property
    def _overlap(self) -> OverlapBound:
        return OverlapBound(self._poses)

    def placed(self, cells: Array) -> PlacedCells:
        """Where cells (n, 7) put the body."""
        return PlacedCells(self._sets, cells)

    def ranges(self, cells: Array) -> PoseRanges:
        """The poses of cells (n, 7)."""
        return self.placed(cells).ranges(self._T_face_object)

    def rulings(self, cells: Array) -> npt.NDArray[np.int64]:
        """(n,) `Ruling` of each of the (n, 7) cells."""
        placed = self.placed(cells)
        ranges = placed.ranges(self._T_face_object)
        result = np.full(len(cells), Ruling.OPEN, dtype=np.int64)
        result[self._overlap.overlapping(ranges)] = Ruling.COLLIDING
        result[self.required.lacking(ranges)] = Ruling.BREAKS_RULE
        result[self._support.unsupported(placed)] = Ruling.UNSUPPORTED
        result[self._reach.out_of_reach(placed)] = Ruling.OUT_OF_REACH
        return result

    def most(self, cells: Array) -> Array:
        """(n,) what ξ does not exceed at any pose of the (n, 7) cells; inf where nothing is
        known."""
        if not (self.bounded and isinstance(self._objective, SlowObjective)):
            return np.full(len(cells), np.inf)
        return self._objective.most_around(self.ranges(cells)) + _ROUNDING

    def beyond_reach(self, cells: Array) -> Array:
        """(n, holdings) m, how much each arm lacks at least to get to any pose of cells (n, 7); 0
        or less where nothing is known to be lacking."""
        return self._reach.beyond(self.placed(cells))
