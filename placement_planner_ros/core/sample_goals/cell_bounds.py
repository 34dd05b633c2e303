"""Cells of the pose sets Ŝ(r, f) that provably hold no placement."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

import numpy as np

from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.contacts.contact_class import ContactClass
from placement_planner_ros.core.contacts.placed_cells import PlacedCells
from placement_planner_ros.core.contacts.support_bounds import SupportBound
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.objective.objective import Objective, PoseRanges, SlowObjective
from placement_planner_ros.core.reach.reach_bound import ReachBound
from placement_planner_ros.core.sample_goals.overlap_bounds import OverlapBound
from placement_planner_ros.core.search.cell_layout import Cells, PoseSets
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.types import SINGLE_ROUNDING, Array, Index, Mask


class _Reach:
    """Whether any arm is long enough: how far its wrist gets from its shoulder is bounded."""

    def __init__(self, contacts: ContactClass, holdings: Iterable[Holding]) -> None:
        # Each arm's bound, with its wrist in the frame of the object.
        bounds, lengths, in_object = [], [], []
        for holding in holdings:
            bound = ReachBound.of(holding.chain)
            bounds.append(bound)
            lengths.append(bound.length + holding.tip_slack)
            in_object.append(holding.arm.grasps[holding.grasp].actInv(bound.wrist))
        wrists = np.array(in_object).reshape(-1, 3)
        self._shoulders = np.array([bound.shoulder for bound in bounds]).reshape(-1, 3)
        self._lengths = np.array(lengths)
        # The wrists in the frame of each face; of what is turned otherwise, how far they are from
        # its reference point.
        frames, shape = contacts.frames, (len(contacts.frames), len(wrists))
        self._wrists, self._around = np.zeros((*shape, 3)), np.zeros(shape)
        for feature, T in enumerate(frames):
            if T is None:
                away = wrists - contacts.references[feature]
                self._around[feature] = np.linalg.norm(away, axis=1)
            else:
                self._wrists[feature] = wrists @ T.rotation.T + T.translation

    def out_of_reach(self, placed: PlacedCells) -> Mask:
        """(n,) cells at none of whose poses any wrist is where its arm can bring it."""
        # How far the wrists are from the shoulders at the middle of each cell.
        wrists = self._wrists[placed.face]
        away = np.abs(placed.middles(wrists) - self._shoulders)
        # A cell brings them nearer by its half sides, turns and rise at most.
        aside = np.maximum(away[..., :2] - placed.half[:, None], 0.0)
        distance = np.maximum(np.hypot(aside[..., 0], aside[..., 1]) - placed.strays(wrists), 0.0)
        height = np.maximum(away[..., 2] - placed.rises(wrists), 0.0)
        beyond = np.hypot(distance, height) - self._lengths - self._around[placed.face]
        return np.asarray((beyond > 0.0).all(axis=1))


class BranchBounds:
    """`CellBounds` of one problem: reach, support, what is required, and ξ.

    Args:
        poses: s(x) and what is required, of one problem.
        holdings: every arm with every grasp that may be used.
        sets: what the cells are of.
        objective: ξ.

    Attributes:
        bounded: whether anything is known of ξ; not where objects may lean.
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
        self._poses = poses
        self._turning = np.array([frame is not None for frame in poses.contacts.frames], np.bool_)
        self._reach = _Reach(poses.contacts, holdings)
        frames = [frame for frame in poses.contacts.frames if frame is not None]
        self._T_face_object = np.array([frame.homogeneous for frame in frames])
        size = np.ptp(poses.problem.body.vertices, axis=0)
        self.turn_radius = 0.5 * float(np.linalg.norm(size))
        # asked once: to tell takes as long as to bound some cells
        slow = isinstance(objective, SlowObjective) and objective.bounded and self._turning.all()
        self._slow = objective if isinstance(objective, SlowObjective) and slow else None
        self.bounded = self._slow is not None

    @cached_property
    def _support(self) -> SupportBound:
        """Made once it is asked for: the first placement is often found before."""
        return SupportBound(self._poses.problem, self._poses.faces.support, self._poses.footing)

    @cached_property
    def _overlap(self) -> OverlapBound:
        return OverlapBound(self._poses)

    def ranges(self, cells: Cells) -> PoseRanges:
        """The poses of cells (n,) of features that are turned about a normal."""
        return PlacedCells(self._sets, cells).ranges(self._T_face_object)

    def rulings(self, cells: Cells) -> Index:
        """(n,) `Ruling` of each of the (n,) cells."""
        # Features that are turned about a normal, of which more is known.
        turned = self._turning[self._sets.face[cells["set"]]]
        if turned.all():
            return self._rulings_of_faces(cells)
        result = np.full(len(cells), Ruling.OPEN, dtype=np.int64)
        if turned.any():
            result[turned] = self._rulings_of_faces(cells[turned])
        # Of the others, what the contacts exclude and what is out of reach.
        others = np.flatnonzero(~turned)
        placed = PlacedCells(self._sets, cells[others])
        low, high = cells["low"][others], cells["high"][others]
        excluded = self._poses.contacts.excluded(placed.face, placed.height, low, high)
        result[others[excluded]] = Ruling.UNSUPPORTED
        result[others[self._reach.out_of_reach(placed)]] = Ruling.OUT_OF_REACH
        return result

    def _rulings_of_faces(self, cells: Cells) -> Index:
        placed = PlacedCells(self._sets, cells)
        result = np.full(len(cells), Ruling.OPEN, dtype=np.int64)
        # Where several hold, the last one written is told.
        if self._poses.required is not None:
            ranges = placed.ranges(self._T_face_object)
            result[self._poses.required.impossible(ranges)] = Ruling.BREAKS_RULE
        result[self._support.unsupported(placed)] = Ruling.UNSUPPORTED
        result[self._reach.out_of_reach(placed)] = Ruling.OUT_OF_REACH
        # The dearest last, of what is left.
        left = np.flatnonzero(result == Ruling.OPEN)
        result[left[self._overlap.overlapping(self.ranges(cells[left]))]] = Ruling.COLLIDING
        return result

    def most(self, cells: Cells, rough: bool = False) -> Array:
        """(n,) what ξ does not exceed at any pose of the (n,) cells; inf where nothing is
        known."""
        if not len(cells) or self._slow is None:
            return np.full(len(cells), np.inf)
        return self._slow.most_around(self.ranges(cells), rough) + SINGLE_ROUNDING
