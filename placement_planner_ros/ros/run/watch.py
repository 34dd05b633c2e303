"""Holds every new cloud against the best placement of a run, as soon as it comes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar

from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import Placement
from placement_planner_ros.ros.inputs.cloud_store import CloudStore, PointSet
from placement_planner_ros.ros.patience import CLOSING_S
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.validity import Way, way_of

Made = TypeVar("Made")

NOT_LOOKED_AT = "it has not been held against newer clouds yet, which takes a moment"
"""Said of a placement until it is known whether anything stands in its way."""
_CANNOT = "it cannot be held against newer clouds"


class Watch:
    """What newer clouds show in the way of the best placement. Safe to use from several threads.

    Looked at in a thread of its own. Until then nothing is known of the placement where clouds have
    come that its run did not begin with.

    Args:
        changed: called, in that thread, when `blocked` is another.
        on_error: told what nobody expected.
    """

    def __init__(
        self,
        clouds: CloudStore,
        changed: Callable[[], None],
        on_error: Callable[[Exception], None],
    ) -> None:
        self._clouds = clouds
        self._changed = changed
        self._on_error = on_error
        self._lock = threading.Lock()
        self._snapshot: Snapshot | None = None
        self._environment: Environment | None = None
        self._wanted: Placement | None = None
        self._looked_at: Placement | None = None
        self._seen: dict[str, tuple[PointSet, str]] = {}
        self._news = threading.Event()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="watch", daemon=True)
        self._thread.start()
        clouds.listen(self._news.set)

    def blocked(self, placement: Placement) -> str:
        """What stands in the way of the run's last placement, in words; '' where nothing does.

        The same words as long as it does; `NOT_LOOKED_AT` until that is known.
        """
        with self._lock:
            if self._looked_at is placement:
                return self._first
            snapshot = self._snapshot
        return NOT_LOOKED_AT if snapshot is None or self._to_look_at(snapshot) else ""

    def follow(self, snapshot: Snapshot) -> None:
        """A run begins with this."""
        with self._lock:
            self._snapshot, self._environment = snapshot, None
            self._wanted, self._looked_at, self._seen = None, None, {}

    def planned_in(self, snapshot: Snapshot, environment: Environment) -> None:
        """What the run that began with the snapshot plans in."""
        with self._lock:
            if self._snapshot is snapshot:
                self._environment = environment

    def placed(self, snapshot: Snapshot, placement: Placement) -> None:
        """The best placement of the run that began with the snapshot is another."""
        with self._lock:
            if self._snapshot is snapshot:
                self._wanted = placement
        self._news.set()

    def look_again(self) -> None:
        """What is known of the environment has been changed by command: forget what was seen."""
        with self._lock:
            self._looked_at, self._seen = None, {}
        self._news.set()

    def close(self) -> None:
        """Look at nothing more."""
        self._closed = True
        self._news.set()
        self._thread.join(CLOSING_S)

    @property
    def _first(self) -> str:
        """What is said first of all that stands in the way; '' where nothing does."""
        return next((words for _, words in self._seen.values() if words), "")

    def _work(self) -> None:
        placement: Placement | None = None
        way: Way | None = None
        while True:
            self._news.wait()
            self._news.clear()
            with self._lock:
                snapshot, environment, wanted = self._snapshot, self._environment, self._wanted
            if self._closed:
                return
            if snapshot is None or environment is None or wanted is None:
                continue
            if wanted is not placement:
                placement = wanted
                if not self._to_look_at(snapshot):
                    self._changed()  # it holds, so nobody need wait
                way = self._made(lambda: way_of(snapshot, environment, wanted))  # noqa: B023
            self._look(snapshot, placement, way)

    def _look(self, snapshot: Snapshot, placement: Placement, way: Way | None) -> None:
        """Hold newer clouds that were not looked at yet against the run's last placement."""
        with self._lock:
            again = self._looked_at is placement
            before, known = self._first, self._seen if again else {}
        keeps = snapshot.parameters["cloud.mode"] == "merge"
        seen: dict[str, tuple[PointSet, str]] = {}
        for topic, cloud in self._to_look_at(snapshot).items():
            last, words = known.get(topic, (None, ""))
            if last is None or last.points is not cloud.points:
                found = self._in_the_way(way, cloud)
                words = words if words and (found or keeps) else found
            seen[topic] = cloud, words
        if way is None:
            seen[""] = PointSet(snapshot.clouds[0]), _CANNOT
        with self._lock:
            if self._wanted is not placement or (again and self._looked_at is not placement):
                return  # there is news
            self._seen, self._looked_at = seen, placement
            changed = self._first != before or not again
        if changed:
            self._changed()

    def _to_look_at(self, snapshot: Snapshot) -> dict[str, PointSet]:
        """Clouds that the run has not begun with, by topic; '' for those merged."""
        clouds = self._clouds.latest()
        if snapshot.parameters["cloud.mode"] == "merge":
            clouds[""] = PointSet(self._clouds.merged)
        return {
            topic: cloud
            for topic, cloud in clouds.items()
            if not any(cloud.points is known for known in snapshot.clouds)
        }

    def _in_the_way(self, way: Way | None, cloud: PointSet) -> str:
        found = self._made(
            lambda: "" if way is None else way.blocked_by(cloud.points, cloud.origin)
        )
        return _CANNOT if found is None else found

    def _made(self, make: Callable[[], Made]) -> Made | None:
        """What that makes; None where it fails: what cannot be looked at is not called valid."""
        try:
            return make()
        except Exception as error:
            self._on_error(error)
            return None
