"""Holds every new cloud against the best placement of a run, as soon as it comes."""

from __future__ import annotations

import threading
from collections.abc import Callable

from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import Placement
from placement_planner_ros.ros.inputs.cloud_store import CloudStore, PointSet
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.validity import Way, way_of

CLOSING_S = 0.5
"""That closing waits at most."""
NOT_LOOKED_AT = "it has not been held against newer clouds yet, which takes a moment"
"""Said of a placement until it is known whether anything stands in its way."""
_CANNOT = "it cannot be held against newer clouds"


class Watch:
    """What newer clouds show in the way of the best placement. Safe to use from several threads.

    A cloud is looked at in the thread that brings it; what that needs of a placement is made in a
    thread of its own, after which the newest clouds are looked at. Until then nothing is known of
    the placement where clouds have come that its run did not begin with.

    Args:
        changed: called, in any thread, when `blocked` is another, or another placement has been
            looked at.
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
        self._way: Way | None = None
        self._blocked: dict[str, str] = {}
        self._news = threading.Event()
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="watch", daemon=True)
        self._thread.start()
        clouds.listen(self._look)

    def blocked(self, placement: Placement) -> str:
        """What stands in the way of the run's last placement, in words; '' where nothing does.

        The same words as long as it does; `NOT_LOOKED_AT` until that is known.
        """
        with self._lock:
            if self._looked_at is placement:
                return _first(self._blocked)
            snapshot = self._snapshot
        return NOT_LOOKED_AT if snapshot is None or self._to_look_at(snapshot) else ""

    def follow(self, snapshot: Snapshot) -> None:
        """A run begins with this."""
        with self._lock:
            self._snapshot, self._environment = snapshot, None
            self._wanted, self._looked_at, self._way = None, None, None
            self._blocked = {}

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
            snapshot, placement, way = self._snapshot, self._wanted, self._way
            if placement is not self._looked_at:
                self._news.set()  # what is being looked at may be what was known before
                way = None
        if snapshot is not None and placement is not None and way is not None:
            self._look_at_all(snapshot, placement, way)
        self._changed()

    def close(self) -> None:
        """Look at nothing more."""
        with self._lock:
            self._closed = True
            self._way = None
            self._news.set()
        self._thread.join(CLOSING_S)

    @property
    def busy(self) -> bool:
        """Whether its thread is still at work."""
        return self._thread.is_alive()

    def _work(self) -> None:
        while True:
            self._news.wait()
            with self._lock:
                self._news.clear()
                if self._closed:
                    return
                snapshot, placement = self._snapshot, self._wanted
                environment = self._environment
            if snapshot is None or environment is None or placement is None:
                continue
            if not self._to_look_at(snapshot):
                self._changed()  # it holds, so nobody need wait
            way, fault = None, ""
            try:
                way = way_of(snapshot, environment, placement)
            except Exception as error:
                # The thread's outermost frame: what cannot be looked at is not called valid.
                fault = f"{_CANNOT}: {error}"
                self._on_error(error)
            if self._look_at_all(snapshot, placement, way, fault):
                self._changed()

    def _look_at_all(
        self, snapshot: Snapshot, placement: Placement, way: Way | None, fault: str = ""
    ) -> bool:
        """Hold all newer clouds against the run's last placement; whether that says anything.

        Args:
            way: the placement's, None where none could be made.
            fault: why not.
        """
        seen = {} if way is None else self._to_look_at(snapshot)
        blocked = {topic: self._in_the_way(way, cloud) for topic, cloud in seen.items() if way}
        if fault:
            blocked[""] = fault
        with self._lock:
            if self._wanted is not placement or self._closed:
                return False
            before, self._blocked = self._blocked, blocked
            self._way, self._looked_at = way, placement
        for topic, cloud in self._to_look_at(snapshot).items():
            if topic not in seen or seen[topic].points is not cloud.points:
                self._look(topic, cloud)
        return bool(seen) or _first(before) != _first(blocked)

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

    def _look(self, topic: str, cloud: PointSet) -> None:
        with self._lock:
            way, snapshot = self._way, self._snapshot
        if way is None or snapshot is None:
            return  # there is no placement, or its clouds are looked at when the way is made
        known = any(cloud.points is points for points in snapshot.clouds)
        blocked = "" if known else self._in_the_way(way, cloud)
        accumulates = snapshot.parameters["cloud.mode"] == "merge"
        with self._lock:
            if self._way is not way:
                return
            before = self._blocked.get(topic, "")
            if before and (blocked or accumulates):
                blocked = before
            self._blocked[topic] = blocked
        if blocked != before:
            self._changed()

    def _in_the_way(self, way: Way, cloud: PointSet) -> str:
        try:
            return way.blocked_by(cloud.points, cloud.origin)
        except Exception as error:
            # What cannot be looked at is not called valid.
            self._on_error(error)
            return f"{_CANNOT}: {error}"


def _first(blocked: dict[str, str]) -> str:
    """What is said first of all that stands in the way; '' where nothing does."""
    return next(filter(None, blocked.values()), "")
