"""Climbers: free poses that move by random steps, so that small pockets are found.

What is best where clearance is minimised lies in pockets smaller than any cell that a search has
time to split, but their basins are larger. Each climber is a (1+1) evolution strategy with the
one-fifth success rule, within its pose set: a step to a usable pose with larger ξ is taken, makes
random ones twice as long, and is repeated until it fails, as walls are oblique; four steps that
fail make them half as long. Turns are about the object's middle, so that what is round stays in its
gap (leaning ones do not turn). Each counts its own tries to reach poses that failed, so that those
who crowd where no arm gets leave tries to others.

Where hands hardly fit such pockets are islands. *Blocked* climbers begin at poses that are better
than ξ_best, but where a hand, its release or its approach is lacking; they wander among such poses,
never to where an earlier check fails, until one is usable. They are spread evenly, in the mean,
over parts of pose sets and what is lacking there: else most gather where no hand ever fits.
"""

from __future__ import annotations

import math

import numpy as np

from placement_planner_ros.core.search.cell_layout import Cells, PoseSets
from placement_planner_ros.core.types import Array, Index, Mask, Verdict

_FIRST_STEP_M = 0.02
"""Standard deviation of each coordinate in the first steps, and in the longest."""
_LAST_STEP_M = 5e-4
"""A climber whose steps are shorter than this has arrived."""
_TURN_RADIUS_M = 0.1
"""m that one radian of θ counts as."""
_PARTS = 4.0, 4.0, 16.0
"""Parts of a pose set along x, y and θ that blocked ones are spread over."""
_CLIMBER = np.dtype(
    [
        ("set", np.int64),
        ("place", np.float64, 3),  # x, y and θ
        ("value", np.float64),  # ξ there, -inf before the first step
        ("failed", np.float64),  # tries to reach poses that its steps led to
        ("verdict", np.int64),  # FEASIBLE where that is usable, else what is lacking
        ("step", np.float64),  # m, standard deviation
        ("way", np.float64, 3),  # the last step as drawn where that was taken, else 0
    ]
)


class Climbers:
    """Those that are on their way.

    Args:
        most: usable ones at most; of blocked ones as many as are gone, up to twice as many.
        rng: draws their steps.
    """

    def __init__(self, sets: PoseSets, most: int, rng: np.random.Generator) -> None:
        self._sets, self._most, self._rng = sets, most, rng
        self._all, self._gone = np.empty(0, dtype=_CLIMBER), 0
        self._next, self._moves, self._least = (self._all[k] for k in ("place", "way", "value"))

    def propose(self, best: float) -> tuple[Index, Array, Array, Array]:
        """The pose sets (n,), the places (n, 3) that the next steps lead to, what ξ (n,) has to
        exceed there: that of where the climbers are, or `best` of those that are blocked; and how
        many tries (n,) of each have failed."""
        own = self._all
        # Along one of x, y and θ as often as along all three.
        along = np.eye(3)[self._rng.integers(3, size=len(own))]
        along[self._rng.random(len(own)) < 0.5] = 1.0
        steps = along * self._rng.normal(size=(len(own), 3)) * own["step"][:, None]
        steps /= (1.0, 1.0, _TURN_RADIUS_M)
        again = own["way"] * self._rng.uniform(0.5, 2.0, (len(own), 1))
        self._moves = np.where(np.any(again, axis=1, keepdims=True), again, steps)
        places = own["place"] + self._moves
        # Turns, thrown back at the ends of their range, are about the middle: the contact point
        # moves with them.
        places[:, 2] = self._within(places)[:, 2]
        before, after = np.exp(1j * np.array([own["place"][:, 2], places[:, 2]]))
        shift = self._sets.middle[own["set"]] * (before - after)
        places[:, :2] += np.column_stack([shift.real, shift.imag])
        self._next = self._within(places)
        self._least = np.where(own["verdict"] < Verdict.FEASIBLE, best, own["value"])
        return own["set"], self._next, self._least, own["failed"]

    def _within(self, places: Array) -> Array:
        """Places (n, 3), thrown back at the ends of the pose sets, but for whole turns, which have
        none."""
        low = self._sets.low[self._all["set"]]
        size = self._sets.high[self._all["set"]] - low
        beyond = (places - low) % np.where(size < (np.inf, np.inf, math.tau), 2.0 * size, size)
        return np.asarray(low + np.minimum(beyond, 2.0 * size - beyond))

    def learn(self, values: Array, verdicts: Index, failed: Mask) -> None:
        """Take the steps proposed last that exceed what they had to, lacking no more, by ξ (n,) and
        verdicts (n,), FEASIBLE where it is usable, of where they lead, and count the tries there
        that failed (n,); who has arrived is gone."""
        own, up = self._all, (verdicts >= self._all["verdict"]) & (values > self._least)
        again = up & (verdicts == Verdict.FEASIBLE)
        own["failed"] += failed
        own["way"] = np.where(again[:, None], self._moves, 0.0)
        own["place"][up], own["value"][up] = self._next[up], values[up]
        own["verdict"][up] = verdicts[up]
        own["step"] = np.minimum(own["step"] * np.where(up, 2.0, 0.5**0.25), _FIRST_STEP_M)
        self._all = own[own["step"] > _LAST_STEP_M]
        self._gone += len(own) - len(self._all)

    def begin(self, sets: Index, places: Array, values: Array, verdicts: Index) -> None:
        """Begin at free places (n, 3) of sets (n,), ξ being at most (n,), by their verdicts (n,).

        At the usable ones with the highest ξ as far as there is room, the first step to a usable
        pose being taken wherever it leads; at the others, spread with those that are blocked
        already.
        """
        rows, climb = np.argsort(-values, kind="stable"), self._all["verdict"] == Verdict.FEASIBLE
        usable = rows[verdicts[rows] == Verdict.FEASIBLE][: max(self._most - np.sum(climb), 0)]
        rows = np.concatenate([usable, np.flatnonzero(verdicts < Verdict.FEASIBLE)])
        new = np.zeros(len(rows), dtype=_CLIMBER)
        new["set"], new["place"], new["verdict"] = sets[rows], places[rows], verdicts[rows]
        new["value"], new["step"] = -np.inf, _FIRST_STEP_M
        own = np.concatenate([self._all, new])
        climb = own["verdict"] == Verdict.FEASIBLE
        self._all = np.concatenate([own[climb], self._spread(own[~climb], int(np.sum(climb)))])

    def _spread(self, blocked: Cells, usable: int) -> Cells:
        """As many of blocked climbers (n,) as there is room for beside usable ones, none or several
        times each: as many, in the mean, of each part of a pose set and what is lacking there."""
        room = min(self._gone, 2 * self._most, 3 * self._most - usable) if len(blocked) else 0
        low, high = self._sets.low[blocked["set"]], self._sets.high[blocked["set"]]
        cells = np.floor((blocked["place"] - low) / (high - low) * _PARTS)
        pairs = np.column_stack([blocked["set"], cells, blocked["verdict"]])
        _, of, counts = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
        # Evenly along the sum of their shares, from a random first on.
        ends = np.cumsum(1.0 / counts[of.ravel()]) / len(counts)
        rows = np.searchsorted(ends, (np.arange(room) + self._rng.random()) / max(room, 1))
        return blocked[np.minimum(rows, len(blocked) - 1)]
