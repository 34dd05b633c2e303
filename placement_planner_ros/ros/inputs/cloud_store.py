"""The clouds so far: all that sensors have shown of the environment."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from placement_planner_ros.core.errors import CloudError, PlacementPlannerError, forget_where
from placement_planner_ros.core.types import Array, Index, Mask
from placement_planner_ros.ros.inputs.point_cloud import MAX_POINTS, some_of

MERGE_FRACTION = 4
"""Merged clouds keep one point per cube of this fraction of a cell's edge."""
CUBE_BITS = 21
"""Of a cube's number for each axis: 2.6 km in each direction of cubes of 2.5 mm, beyond which
nothing accumulates."""


class CloudStaleError(PlacementPlannerError):
    """Clouds are older than cloud.max_age."""

    code = "CLOUD_STALE"


@dataclass(frozen=True, slots=True, eq=False)
class PointSet:
    """A cloud, or another part of the environment, in the planning frame.

    Attributes:
        points: (n, 3) metres.
        origin: (3,) of the sensor that saw all of it, metres; None where that is not known.
        placed: whether it is known, hence no part of the robot nor in its hand.
        topic: of which it is the newest cloud, else empty.
        time: when it was taken, seconds of the steady clock.
        arrival: greater than that of clouds that arrived before it.
    """

    points: Array
    origin: Array | None = None
    placed: bool = False
    topic: str = ""
    time: float = 0.0
    arrival: int = 0

    @property
    def eye(self) -> tuple[float, ...]:
        """The origin; () without one."""
        return () if self.origin is None else tuple(self.origin.tolist())

    def same(self, other: PointSet) -> bool:
        """Whether both hold the same array, seen from the same place."""
        return self.points is other.points and self.placed == other.placed and self.eye == other.eye


@dataclass(frozen=True, slots=True, eq=False)
class MergedPoints:
    """Of each cube the first point that came, in the order in which they came.

    Attributes:
        points: (n, 3) metres.
        edge: of the cubes, metres.
        cubes: (n,) numbers of the cubes, ascending.
    """

    points: Array
    edge: float
    cubes: Index

    @classmethod
    def of(cls, points: Array, edge: float) -> MergedPoints:
        """Points (n, 3), thinned."""
        return cls(np.empty((0, 3)), edge, np.empty(0, np.int64)).with_points(points, edge)

    def with_points(self, points: Array, edge: float) -> MergedPoints:
        """The same and the points (n, 3) that lie in further cubes; itself where none does."""
        # cubes of another size are numbered anew
        if edge != self.edge:
            return MergedPoints.of(self.points, edge).with_points(points, edge)
        limit = 1 << CUBE_BITS - 1
        # one number for each cube, of the three along the axes
        cells = np.floor(points / edge)
        near = (np.abs(cells) < limit).all(axis=1)
        x, y, z = cells[near].astype(np.int64).T + limit
        # of each cube the first point that comes, if none is in it yet
        coming, first = np.unique((x << 2 * CUBE_BITS) + (y << CUBE_BITS) + z, return_index=True)
        new = ~np.isin(coming, self.cubes, assume_unique=True)
        if not new.any():
            return self
        # numbers stay ascending, points stay in the order in which they came
        places = np.searchsorted(self.cubes, coming[new])
        cubes = np.insert(self.cubes, places, coming[new])
        further = points[near][np.sort(first[new])]
        return MergedPoints(np.vstack([self.points, further]), edge, cubes)

    def without(self, which: Mask) -> MergedPoints:
        """The same without some of the points (n,)."""
        return MergedPoints.of(self.points[~which], self.edge) if which.any() else self


class CloudStore:
    """Clouds by topic. Safe to use from several threads; what it hands out is never modified.

    Args:
        required: topics of which a cloud is needed.

    Attributes:
        updates: clouds taken.
        changes: how often the contents became other ones.
    """

    def __init__(self, required: Sequence[str]) -> None:
        self._required = tuple(required)
        self._lock = threading.Lock()
        self._latest: dict[str, PointSet] = {}
        self._merged = MergedPoints.of(np.empty((0, 3)), 1.0)
        self._refused: dict[str, PlacementPlannerError] = {}
        self.updates = 0
        self.changes = 0

    def add(self, cloud: PointSet) -> bool:
        """Take a cloud as the newest of its topic; False where one that arrived later is known.

        One that shows nothing new is not a change.
        """
        topic = cloud.topic
        with self._lock:
            before = self._latest.get(topic)
        # compared without the lock, as that takes a while
        same = before is not None and before.eye == cloud.eye
        if before is not None and same:
            # most that are others differ everywhere
            same = np.array_equal(some_of(before.points), some_of(cloud.points))
            same = same and np.array_equal(before.points, cloud.points)
            cloud = replace(cloud, points=before.points) if same else cloud
        with self._lock:
            # several threads take clouds, so an older one may come through later
            newest = self._latest.get(topic)
            if newest is not None and newest.arrival > cloud.arrival:
                return False
            self._latest[topic] = cloud
            known = self._refused.pop(topic, None)
            self.updates += 1
            # one after a refused one is a change, even where it shows the same
            self.changes += not same or known is not None
        return True

    def merge(self, points: Array, cell_size: float) -> None:
        """Add points (n, 3) to those accumulated, thinned to a fraction of a cell.

        Begun anew where others were merged, or all cleared, in the meantime.

        Raises:
            CloudError: they would be more than `MAX_POINTS`; none of them is added then.
        """
        while True:
            with self._lock:
                before = self._merged
            # without the lock, as that takes a while
            merged = before.with_points(points, cell_size / MERGE_FRACTION)
            if len(merged.points) > MAX_POINTS:
                raise CloudError(
                    "clouds: merged",
                    f"{len(merged.points)} points",
                    f"there may be {MAX_POINTS}; call clear_environment, raise cloud.cell_size, or "
                    "publish what is near the robot only",
                )
            with self._lock:
                if self._merged is before:
                    self._merged = merged
                    return

    def refuse(self, topic: str, error: PlacementPlannerError) -> None:
        """Note that a topic's newest cloud was unusable."""
        forget_where(error)
        with self._lock:
            self._refused[topic] = error

    def forget(self, which: Callable[[Array], Mask]) -> None:
        """Forget those of the accumulated points (n, 3) for which that is true, (n,)."""
        with self._lock:
            self._merged = self._merged.without(which(self._merged.points))
            self.changes += 1

    def clear(self) -> None:
        """Forget accumulated points."""
        with self._lock:
            self._merged = MergedPoints.of(np.empty((0, 3)), 1.0)
            self.changes += 1

    def ages(self, now: float) -> dict[str, float]:
        """Seconds since each topic's newest cloud was taken."""
        with self._lock:
            return {topic: now - cloud.time for topic, cloud in self._latest.items()}

    def latest(self) -> dict[str, PointSet]:
        """Each topic's newest cloud."""
        with self._lock:
            return dict(self._latest)

    @property
    def merged(self) -> Array:
        """The points (n, 3) accumulated."""
        with self._lock:
            return self._merged.points

    def stale(self, max_age: float, now: float) -> dict[str, float]:
        """Seconds since the newest usable cloud was taken, of topics where that is too long ago.

        Args:
            max_age: seconds; 0 for any age.
        """
        return {t: age for t, age in self.ages(now).items() if 0.0 < max_age < age}

    def faults(
        self, mode: str, max_age: float, now: float, needed: bool = True
    ) -> list[PlacementPlannerError]:
        """Everything for which the environment is not known.

        Args:
            mode: `latest` or `merge`.
            max_age: seconds, for `latest`; 0 for any age.
            needed: False where other things are known: then clouds need not have come.
        """
        with self._lock:
            # A traceback would grow each time.
            faults = [error.with_traceback(None) for error in self._refused.values()]
            latest = {t: cloud for t, cloud in self._latest.items() if t not in self._refused}
            missing = [t for t in self._required if t not in self._latest | self._refused]
        ages = {t: age for t, age in self.stale(max_age, now).items() if t in latest}
        if missing and needed:
            faults.append(CloudError("clouds", missing, "no cloud has arrived on this topic yet"))
        if mode == "latest" and ages:
            words = (
                f"older than cloud.max_age = {max_age:g} s; publish them again, stamped by the "
                "clock of the joint states, or set it to 0"
            )
            shown = {topic: f"{age:.1f} s" for topic, age in ages.items()}
            faults.append(CloudStaleError("clouds: ages", shown, words))
        if needed and not faults and not self.parts(mode):
            words = (
                "every cloud is empty: there is no finite point in any; look at the sensor, or "
                "name the topics that show the surroundings in cloud_topics"
            )
            where = f"0 points on {', '.join(latest) or 'any topic'}"
            faults.append(CloudError("clouds", where, words))
        return faults

    def parts(self, mode: str) -> tuple[PointSet, ...]:
        """Every point set of what sensors have shown.

        Accumulated points come without an origin, as they were seen from several.

        Args:
            mode: `latest` or `merge`.
        """
        with self._lock:
            sets = [*self._latest.values()]
            if mode == "merge":
                sets.append(PointSet(self._merged.points))
        return tuple(part for part in sets if len(part.points))
