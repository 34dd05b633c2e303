"""Snapshots that differ in what was seen."""

from dataclasses import replace

from placement_planner_ros.ros.inputs.cloud_store import PointSet


def parts_of(clouds, origins=None, placed=None):
    """Point sets, each seen from somewhere, or known."""
    origins = origins or (None,) * len(clouds)
    placed = placed or (False,) * len(clouds)
    return tuple(map(PointSet, clouds, origins, placed))


def seen(snapshot, clouds=None, origins=None, placed=None, **changes):
    """The same snapshot with other clouds, seen from elsewhere or known."""
    before = snapshot.parts
    return replace(
        snapshot,
        parts=parts_of(
            snapshot.clouds if clouds is None else clouds,
            tuple(part.origin for part in before) if origins is None else origins,
            tuple(part.placed for part in before) if placed is None else placed,
        ),
        **changes,
    )
