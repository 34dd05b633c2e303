"""From the clouds of a snapshot to the environment, without the robot and the held object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.problem import workspace
from placement_planner_ros.core.scene.cloud_agreement import Disagreement, disagreements
from placement_planner_ros.core.scene.environment import Environment, require_room
from placement_planner_ros.core.scene.extent import cropped
from placement_planner_ros.core.scene.flying_pixels import flying_pixels
from placement_planner_ros.core.scene.near_points import NearPoints
from placement_planner_ros.core.scene.visibility import View
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.cloud_store import PointSet
from placement_planner_ros.ros.inputs.self_filter import (
    Outline,
    held_outlines,
    near_points,
    outside_robot,
)
from placement_planner_ros.ros.run.snapshot import Snapshot

Mask = npt.NDArray[np.bool_]

_MAKE_POINTS = ("contact_tolerance", "target_volume", "cloud.cell_size", "max_slope",
                "clearance.beyond_volume", "self_filter.enabled", "unknown_space")  # fmt: skip
"""Parameters on which an environment depends ..."""
_MAKE_HANDS = ("self_filter.padding", "self_filter.padding_of", "collision_margin")
"""... and those on which what the robot hides does."""


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """All that an environment is made from.

    Attributes:
        snapshot: the inputs.
        points: (n, 3) neither near the robot nor near the held object, nor flying, planning frame.
        near: of those that are near, what may be something else.
        bounds: lower (3,) and upper (3,) corner of what the obstacle set covers.
        sights: of clouds whose sensor's place is known, without flying pixels.
        disagreements: of clouds whose heights contradict each other.
        flying: per cloud, (n,) which of its points are flying pixels.
    """

    snapshot: Snapshot
    points: Array
    near: NearPoints
    bounds: tuple[Array, Array]
    sights: tuple[View, ...]
    disagreements: tuple[Disagreement, ...]
    flying: tuple[Mask, ...]

    @classmethod
    def of(cls, snapshot: Snapshot, before: Surroundings | None = None) -> Surroundings:
        """Filter the robot and what it holds out of the clouds.

        Args:
            before: what was made of an earlier snapshot; returned where nothing has changed.
        """
        if before is not None and before.made_of(snapshot):
            return before
        flying = _flying_of_each(snapshot, before)
        points, real = np.vstack(snapshot.clouds), ~np.concatenate(flying)
        kept, near = np.ones(len(points), np.bool_), NearPoints()
        if snapshot.parameters["self_filter.enabled"]:
            measured = np.repeat([not p.placed for p in snapshot.parts], _sizes(snapshot))
            rows = np.flatnonzero(measured & real)
            kept[rows], near = _beside_robot(snapshot, points[rows])
        each_kept = np.split(kept, np.cumsum(_sizes(snapshot))[:-1])
        left = points[kept & real]
        return cls(
            snapshot,
            left,
            near,
            grid_bounds(snapshot, left),
            _sights(snapshot, each_kept, flying),
            _disagreements(snapshot, each_kept, flying),
            flying,
        )

    def made_of(self, snapshot: Snapshot) -> bool:
        """Whether these are that snapshot's, as far as can be told at a glance."""
        mine = self.snapshot
        return (
            len(mine.parts) == len(snapshot.parts)
            and all(map(_is_same_part, mine.parts, snapshot.parts))
            and _agree(mine, snapshot, _MAKE_POINTS)
            and _have_same_hands(mine, snapshot)
        )

    def same(self, other: Surroundings) -> bool:
        """Whether both make the same environment."""
        return self is other or (
            self._rules == other._rules
            and len(self._arrays) == len(other._arrays)
            and all(map(np.array_equal, self._arrays, other._arrays))
            and self.near.same(other.near)
            and (not self._is_unknown_occupied or _have_same_hands(self.snapshot, other.snapshot))
        )

    @property
    def _is_unknown_occupied(self) -> bool:
        return bool(self.sights) and self.snapshot.parameters["unknown_space"] != "free"

    @property
    def _rules(self) -> tuple[object, ...]:
        """What must be equal."""
        parameters = self.snapshot.parameters
        return (
            parameters.grid_settings,
            parameters.region_settings,
            parameters["target_volume"],
            parameters["clearance.beyond_volume"],
            parameters["unknown_space"] if self.sights else "",
            [str(each) for each in self.disagreements],
        )

    @property
    def _arrays(self) -> list[Any]:
        """What must be equal, element by element."""
        sights = [array for view in self.sights for array in (view.origin, view.points, view.hides)]
        return [*self.bounds, self.points, *sights]

    def environment(self) -> Environment:
        """Preprocess the points.

        Raises:
            PlacementPlannerError: they are unusable.
        """
        snapshot, parameters = self.snapshot, self.snapshot.parameters
        robot, q, arms, body = snapshot.robot, snapshot.q_start, snapshot.arms, snapshot.body
        around = max(parameters["self_filter.padding"], parameters["collision_margin"])
        unknown = parameters["unknown_space"] != "free"
        made = Environment.from_points(
            self.points,
            parameters.volume,
            parameters.grid_settings,
            parameters.region_settings,
            self.bounds,
            views=self.sights if unknown else (),
            sights=() if unknown else self.sights,
            outside_robot=lambda centers, distance: outside_robot(
                centers, robot, q, arms, body, around + distance
            ),
            unknown_below=parameters["unknown_space"] == "occupied_below",
            beyond_volume=parameters["clearance.beyond_volume"],
        )
        return made.with_disagreements(self.disagreements).with_near(self.near)


def _sizes(snapshot: Snapshot) -> list[int]:
    return [len(cloud) for cloud in snapshot.clouds]


def _beside_robot(snapshot: Snapshot, points: Array) -> tuple[Mask, NearPoints]:
    """Which of points (n, 3) are not near the robot; of the others, what may be something else."""
    parameters, q = snapshot.parameters, snapshot.q_start
    padding = parameters["self_filter.padding"]
    robot = Outline.of_robot(snapshot.robot, q, padding, parameters.padding_of)
    held = held_outlines(snapshot.robot, q, snapshot.arms, snapshot.body, padding)
    clear = parameters.planner_settings.collision.clear
    kept, near = near_points(points, robot, held, clear, parameters.grid_settings)
    return kept, near.within(*_workspace(snapshot))


def _disagreements(
    snapshot: Snapshot, kept: list[Mask], flying: tuple[Mask, ...]
) -> tuple[Disagreement, ...]:
    """Which of the topics' clouds contradict each other, by points that are kept."""
    rows = [i for i, part in enumerate(snapshot.parts) if part.topic]
    parts = [snapshot.parts[i] for i in rows]
    return tuple(
        disagreements(
            [snapshot.parts[i].points[kept[i] & ~flying[i]] for i in rows],
            [part.topic for part in parts],
            [part.time for part in parts],
            snapshot.parameters["contact_tolerance"],
        )
    )


def _flying_of_each(snapshot: Snapshot, before: Surroundings | None) -> tuple[Mask, ...]:
    """Per cloud, (n,) which of its points are flying pixels; clouds that were there before are not
    looked at again."""
    known = [] if before is None else list(zip(before.snapshot.parts, before.flying, strict=True))
    found = []
    for part in snapshot.parts:
        if part.origin is None or part.placed:
            found.append(np.zeros(len(part.points), np.bool_))
            continue
        same = (flies for other, flies in known if _is_same_part(part, other))
        flies = next(same, None)
        found.append(flying_pixels(part.points, part.origin) if flies is None else flies)
    return tuple(found)


def _sights(snapshot: Snapshot, kept: list[Mask], flying: tuple[Mask, ...]) -> tuple[View, ...]:
    """Of each cloud whose sensor's place is known what it saw.

    Lines of sight that pass through the box around an object placed since tell nothing any more.

    Args:
        kept: per cloud, (n,) points that the robot does not carry.
    """
    placed = [(p.points.min(axis=0), p.points.max(axis=0)) for p in snapshot.parts if p.placed]
    sights, unknown = [], snapshot.parameters["unknown_space"] != "free"
    for part, hides, flies in zip(snapshot.parts, kept, flying, strict=True):
        if part.origin is None:
            continue
        # the robot's points tell of unknown space what they do not hide; else they are left out, so
        # that a robot that moves makes no environment anew
        tells = ~flies if unknown else ~flies & hides
        for lower, upper in placed:
            tells &= ~_passes_through(part.points, part.origin, lower, upper)
        sights.append(View(part.points[tells], part.origin, hides[tells]))
    return tuple(sights)


def _passes_through(points: Array, origin: Array, lower: Array, upper: Array) -> Mask:
    """(n,) whether the line from a place to each point passes through a box and out of it again."""
    along = points - origin
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (lower - origin) / along, (upper - origin) / along
        enters = np.nanmax(np.minimum(first, second), axis=1)
        leaves = np.nanmin(np.maximum(first, second), axis=1)
    return np.asarray((enters < leaves) & (enters > 0.0) & (leaves < 1.0))


def _is_same_part(a: PointSet, b: PointSet) -> bool:
    """Whether two point sets hold the same array, seen from the same place."""
    if a.points is not b.points or a.placed != b.placed:
        return False
    if a.origin is None or b.origin is None:
        return a.origin is b.origin
    return np.array_equal(a.origin, b.origin)


def _agree(a: Snapshot, b: Snapshot, names: tuple[str, ...]) -> bool:
    """Whether these parameters are the same."""
    return all(a.parameters[name] == b.parameters[name] for name in names)


def _have_same_hands(a: Snapshot, b: Snapshot) -> bool:
    """Whether robot and held object fill the same space."""
    hands = [
        [(arm.joints, arm.tip_frame, arm.grasps) for arm in snapshot.arms] for snapshot in (a, b)
    ]
    return (
        a.robot is b.robot
        and a.body is b.body
        and np.array_equal(a.q_start, b.q_start)
        and hands[0] == hands[1]
        and _agree(a, b, _MAKE_HANDS)
    )


def _workspace(snapshot: Snapshot) -> tuple[Array, Array]:
    volume = snapshot.parameters.volume
    return workspace(snapshot.robot, snapshot.arms, snapshot.q_start, snapshot.body, volume)


def grid_bounds(snapshot: Snapshot, points: Array) -> tuple[Array, Array]:
    """Box (lower (3,), upper (3,)) that the obstacle set must cover.

    Where arm, hand and object can be; of that, only what points (n, 3) lie in, unless unseen space
    counts too.
    """
    parameters = snapshot.parameters
    lower, upper = _workspace(snapshot)
    seen = any(part.origin is not None for part in snapshot.parts)
    if parameters["unknown_space"] != "free" and seen:
        return lower, upper
    found = cropped(lower, upper, points, float(parameters["cloud.cell_size"]))
    return (parameters.volume.lower, parameters.volume.upper) if found is None else found


def require_grid(snapshot: Snapshot) -> None:
    """Refuse cells so small that the obstacle set, or the target volume, would have too many.

    Raises:
        ParameterError: they are.
        VolumeError: the target volume is too large.
    """
    settings = snapshot.parameters.grid_settings
    require_room(snapshot.parameters.volume, settings.cell_size)

    def too_many(lower: Array, upper: Array) -> bool:
        return float(np.prod((upper - lower) / settings.cell_size + 2.0)) > settings.max_cells

    if not too_many(*_workspace(snapshot)):
        return  # Without a look at the points, as start has little time.
    lower, upper = grid_bounds(snapshot, np.vstack(snapshot.clouds))
    if too_many(lower, upper):
        size = " x ".join(f"{side:.3g}" for side in upper - lower)
        raise ParameterError(
            "cloud.cell_size",
            settings.cell_size,
            f"makes more than {settings.max_cells} cells of the {size} m that are of interest; "
            "set it higher, or a target_volume nearer to the robot",
        )


def environment_notes(snapshot: Snapshot, environment: Environment | None) -> list[str]:
    """Which clouds contradict each other, and what to tell of `unknown_space`: how much of V was
    seen, or that nobody can tell.

    Args:
        environment: the run's; None where it is yet to be made.
    """
    notes = [
        f"clouds disagree: {each}, over a patch that both see; nothing is put down there where "
        "that is more than contact_tolerance and noise: calibrate the cameras"
        for each in (() if environment is None else environment.disagreements)
    ]
    asked = snapshot.parameters["unknown_space"]
    if asked != "free" and all(part.origin is None for part in snapshot.parts):
        notes.append(
            f"unknown_space: {asked} has no effect, for nobody knows where any cloud was seen "
            "from; publish organised clouds in their optical frame, or name their frame in "
            "sensor_frames"
        )
    elif asked != "free" and environment is not None and environment.seen is not None:
        upto = " up to the highest thing measured" if asked == "occupied_below" else ""
        notes.append(
            f"the sensors have seen {environment.seen:.0%} of target_volume; with unknown_space: "
            f"{asked} the rest counts as occupied{upto}"
        )
    return notes
