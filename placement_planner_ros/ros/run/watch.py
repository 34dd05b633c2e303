"""Holds new clouds against the best placement of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import Placement
from placement_planner_ros.ros.inputs.cloud_store import CloudStore, PointSet
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.validity import Way, way_of
from placement_planner_ros.ros.spinning import survive

Made = TypeVar("Made")

NOT_LOOKED_AT = "it has not been held against newer clouds yet, which takes a moment"
"""Said of a placement until it is known whether anything stands in its way."""
_CANNOT = "it cannot be held against newer clouds"


@dataclass(frozen=True, slots=True, eq=False)
class _Looked:
    """What was seen of a placement's way.

    Attributes:
        seen: the cloud looked at last, of each topic, and what of it stands in the way, in words.
    """

    placement: Placement | None = None
    way: Way | None = None
    seen: dict[str, tuple[PointSet, str]] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """What is said first of all that stands in the way; '' where nothing does."""
        if self.way is None:
            return _CANNOT
        return next((words for _, words in self.seen.values() if words), "")


class Watch:
    """What newer clouds show in the way of the best placement.

    `look` is for one thread; `blocked` may be asked by any. Until a placement was looked at nothing
    is known of it where clouds have come that its run did not begin with.

    Args:
        on_error: told what nobody expected.
    """

    def __init__(self, clouds: CloudStore, on_error: Callable[[BaseException], None]) -> None:
        self._clouds = clouds
        self._on_error = on_error
        self._looked = _Looked()

    def blocked(self, snapshot: Snapshot, placement: Placement) -> str:
        """What stands in the way of the last placement of the run that began with the snapshot, in
        words; '' where nothing does.

        The same words as long as it does; `NOT_LOOKED_AT` until that is known.
        """
        # read once, as the thread that looks replaces it as a whole
        looked = self._looked
        if looked.placement is placement:
            return looked.words
        return NOT_LOOKED_AT if self._to_look_at(snapshot) else ""

    def look_again(self) -> None:
        """What is known of the environment has been changed by command: forget what was seen."""
        self._looked = _Looked()

    def look(self, snapshot: Snapshot, environment: Environment, placement: Placement) -> None:
        """Hold newer clouds that were not looked at yet against the run's last placement."""
        known, clouds = self._looked, self._to_look_at(snapshot)
        before, way = known, known.way
        if before.placement is not placement:
            way = self._made(lambda: way_of(snapshot, environment, placement))
            before = _Looked(placement)
        # what was merged once stays in the way until it is forgotten
        keeps = snapshot.parameters["cloud.mode"] == "merge"
        seen: dict[str, tuple[PointSet, str]] = {}
        for topic, cloud in clouds.items():
            last, words = before.seen.get(topic, (None, ""))
            # a cloud is known by its array, so each is looked at once
            if last is None or last.points is not cloud.points:
                found = self._in_the_way(way, cloud)
                # the same words as long as anything is in the way, wherever it is by then
                words = words if words and (found or keeps) else found
            seen[topic] = cloud, words
        if self._looked is known:  # else there is news, and it is looked at again
            self._looked = _Looked(placement, way, seen)

    def _to_look_at(self, snapshot: Snapshot) -> dict[str, PointSet]:
        """Clouds that the run has not begun with, by topic; '' for those merged."""
        clouds = self._clouds.latest()
        if snapshot.parameters["cloud.mode"] == "merge":
            clouds[""] = PointSet(self._clouds.merged)
        # a cloud that shows nothing new keeps the array of the one before
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
        return survive(make, self._on_error)
