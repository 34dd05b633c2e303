"""Climbers: usable poses that move uphill by random steps, so that small pockets are found.

What is best where clearance is minimised lies in pockets smaller than any cell that a search has
time to split, but their basins are larger. Each climber is a (1+1) evolution strategy with the
one-fifth success rule, within its pose set: a step to a usable pose with larger ξ is taken, makes
random ones twice as long, and is repeated until it fails, as walls are oblique; four steps that
fail make them half as long.
"""

from __future__ import annotations

import math

import numpy as np

from placement_planner_ros.core.search.cell_layout import PoseSets
from placement_planner_ros.core.types import Array, Index, Mask

_FIRST_STEP_M = 0.02
"""Standard deviation of each coordinate in the first steps, and in the longest."""
_LAST_STEP_M = 5e-4
"""A climber whose steps are shorter than this has arrived."""
_TURN_RADIUS_M = 0.1
"""m that one radian of θ counts as."""
_CLIMBER = np.dtype(
    [
        ("set", np.int64),
        ("place", np.float64, 3),  # x, y and θ
        ("value", np.float64),  # ξ there
        ("step", np.float64),  # m, standard deviation
        ("way", np.float64, 3),  # the last step where that was taken, else 0
    ]
)


class Climbers:
    """Those that are on their way.

    Args:
        most: how many there are at most.
        rng: draws their steps.
    """

    def __init__(self, sets: PoseSets, most: int, rng: np.random.Generator) -> None:
        self._sets, self._most, self._rng = sets, most, rng
        self._all = np.empty(0, dtype=_CLIMBER)
        self._next = self._all["place"]

    def propose(self) -> tuple[Index, Array, Array]:
        """The pose sets (n,), the places (n, 3) that the next steps lead to, and ξ (n,) of where
        the climbers are."""
        own = self._all
        # Along one of x, y and θ as often as along all three.
        along = np.eye(3)[self._rng.integers(3, size=len(own))]
        along[self._rng.random(len(own)) < 0.5] = 1.0
        steps = along * self._rng.normal(size=(len(own), 3)) * own["step"][:, None]
        steps /= (1.0, 1.0, _TURN_RADIUS_M)
        again = own["way"] * self._rng.uniform(0.5, 2.0, (len(own), 1))
        places = own["place"] + np.where(np.any(again, axis=1, keepdims=True), again, steps)
        # Thrown back at the ends of the pose set, but for a whole turn, which has none.
        low = self._sets.low[own["set"]]
        size = self._sets.high[own["set"]] - low
        places = (places - low) % np.where(size < (np.inf, np.inf, math.tau), 2.0 * size, size)
        self._next = low + np.minimum(places, 2.0 * size - places)
        return own["set"], self._next, own["value"]

    def learn(self, values: Array, usable: Mask) -> None:
        """Take the steps proposed last that lead higher, by ξ (n,) of where they lead and whether
        that is usable; those that have arrived are gone."""
        own, up = self._all, usable & (values > self._all["value"])
        own["way"] = np.where(up[:, None], self._next - own["place"], 0.0)
        own["place"][up], own["value"][up] = self._next[up], values[up]
        own["step"] = np.minimum(own["step"] * np.where(up, 2.0, 0.5**0.25), _FIRST_STEP_M)
        self._all = own[own["step"] > _LAST_STEP_M]

    def begin(self, sets: Index, places: Array, values: Array) -> None:
        """Begin at usable places (n, 3) of sets (n,), ξ being at most (n,), the highest first, as
        far as there is room; the first step to a usable pose is taken, wherever it leads."""
        rows = np.argsort(-values, kind="stable")[: self._most - len(self._all)]
        new = np.zeros(len(rows), dtype=_CLIMBER)
        new["set"], new["place"] = sets[rows], places[rows]
        new["value"], new["step"] = -np.inf, _FIRST_STEP_M
        self._all = np.concatenate([self._all, new])
