"""Steps along a constraint that random configurations do not keep: project and extend.

As in CBiRRT (Berenson, Srinivasa, Ferguson and Kuffner, 2009), a step towards a target is taken in
the whole space, projected back to where the constraint holds, and kept where it came nearer to the
target. Here the whole edge is asked, not only its end, and a step that fails is halved, as straight
edges leave a constraint that is curved.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from placement_planner_ros.core.types import Array

_SHORTEST_SHARE = 0.01
"""Share of the longest step below which no shorter one is tried, nor one that comes nearer to its
target by less."""


class Constraint(Protocol):
    """What configurations must keep, beside being free."""

    def project(self, q: Array) -> Array | None:
        """A configuration (dof,) near q that keeps it, within the bounds; None where there is none.

        One that keeps it is left as it is.
        """
        ...

    def keeps(self, a: Array, b: Array) -> bool:
        """Whether all of the straight motion between two configurations keeps it."""
        ...


class ProjectedSteps:
    """Steps from configuration to configuration, each edge keeping the constraint.

    Args:
        longest: step, the norm over the joints.

    Attributes:
        constraint: as given.
    """

    def __init__(self, constraint: Constraint, longest: float) -> None:
        self.constraint = constraint
        self._longest = longest
        self._length = longest

    def begin(self) -> None:
        """Try the longest step next, in a new direction."""
        self._length = self._longest

    def step(self, q: Array, target: Array) -> tuple[Array, bool] | None:
        """A configuration on the way from `q` to `target`, and whether it is the target.

        Both keep the constraint. None where no step comes nearer.
        """
        difference = target - q
        distance = _norm_of(difference)
        # Start from the length that worked last, doubled.
        length = min(2.0 * self._length, self._longest)
        shortest = _SHORTEST_SHARE * self._longest
        while length >= shortest:
            # The target is within reach: it is the step, if the edge keeps the constraint.
            if distance <= length:
                if self.constraint.keeps(q, target):
                    self._length = length
                    return target, True
            else:
                # A step towards the target, projected, if it comes nearer.
                near = self.constraint.project(q + (length / distance) * difference)
                if (
                    near is not None
                    and _norm_of(target - near) <= distance - shortest
                    and self.constraint.keeps(q, near)
                ):
                    self._length = length
                    return near, False
            length *= 0.5
        return None

    def walk(self, a: Array, b: Array, longest: float) -> list[Array] | None:
        """Configurations after `a`, the last of them `b`; None where no way shorter than `longest`
        is found like that."""
        way, gone = [a], 0.0
        self.begin()
        while True:
            # A step onward, until the way grows too long.
            step = self.step(way[-1], b)
            if step is None:
                return None
            gone += _norm_of(step[0] - way[-1])
            if gone + _norm_of(b - step[0]) >= longest:
                return None
            way.append(step[0])
            if step[1]:
                return way[1:]


def _norm_of(difference: Array) -> float:
    return float(np.linalg.norm(difference))


def without_repetition(points: Array | list[Array]) -> Array:
    """The (n, dof) points less those equal to their predecessor."""
    moved = np.ones(len(points), dtype=bool)
    moved[1:] = (np.diff(points, axis=0) != 0.0).any(axis=1)
    return np.asarray(points)[moved]
