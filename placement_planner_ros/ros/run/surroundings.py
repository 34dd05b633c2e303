"""From the clouds of a snapshot to the environment, without the robot and the held object."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.problem import workspace
from placement_planner_ros.core.scene.cloud_agreement import Disagreement, disagreements
from placement_planner_ros.core.scene.environment import Environment, require_room
from placement_planner_ros.core.scene.extent import cropped
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.scene.near_points import NearPoints
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.scene.visibility import View
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.ros.inputs.self_filter import (
    Outline,
    held_outlines,
    near_points,
    outside_robot,
)
from placement_planner_ros.ros.run.real_clouds import RealCloud
from placement_planner_ros.ros.run.snapshot import Snapshot


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """All that an environment is made from, and nothing else.

    Attributes:
        points: (n, 3) neither near the robot nor near the held object, nor flying, planning frame.
        near: of those that are near, what may be something else.
        bounds: lower (3,) and upper (3,) corner of the workspace.
        sights: of clouds whose sensor's place is known, without flying pixels.
        snapshot: where the robot is, which only `unknown` looks at.
        unknown: what sights leave unknown is occupied.
        unknown_below: `unknown_space` is occupied_below.
        beyond_volume: `clearance.beyond_volume`.
        disagreements: of clouds whose heights contradict each other.
        clouds: those of the snapshot, without flying pixels, thinned.
        kept: (n,) which of their points are `points`.
    """

    points: Array
    near: NearPoints
    bounds: tuple[Array, Array]
    volume: TargetVolume
    grid: GridSettings
    regions: RegionSettings
    sights: tuple[View, ...]
    snapshot: Snapshot
    unknown: bool = False
    unknown_below: bool = False
    beyond_volume: bool = True
    disagreements: tuple[Disagreement, ...] = ()
    clouds: tuple[RealCloud, ...] = ()
    kept: npt.NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))

    @classmethod
    def of(cls, snapshot: Snapshot, before: Surroundings | None = None) -> Surroundings:
        """Filter the robot and what it holds out of the clouds.

        Args:
            before: what was made of an earlier snapshot; returned where nothing has changed.
        """
        if before is not None and before.made_of(snapshot):
            return before
        clouds = RealCloud.all_of(snapshot, () if before is None else before.clouds)
        points = np.vstack([cloud.points for cloud in clouds])
        kept, near = np.ones(len(points), np.bool_), NearPoints()
        if snapshot.parameters["self_filter.enabled"]:
            measured = [np.full(len(cloud.points), not cloud.placed) for cloud in clouds]
            rows = np.flatnonzero(np.concatenate(measured))
            kept[rows], near = _near(snapshot, points[rows])
        parameters = snapshot.parameters
        asked = parameters["unknown_space"]
        made = cls(
            np.zeros((0, 3)),
            near,
            _workspace(snapshot),
            parameters.volume,
            parameters.grid_settings,
            parameters.region_settings,
            (),
            snapshot,
            asked != "free",
            asked == "occupied_below",
            bool(parameters["clearance.beyond_volume"]),
            (),
            clouds,
            kept,
        )
        if before is not None and made._takes_from_clouds_as(before):
            return replace(
                made,
                points=before.points,
                sights=before.sights,
                disagreements=before.disagreements,
            )
        return replace(
            made,
            points=points[kept],
            sights=made._sights(),
            disagreements=made._contradictions(),
        )

    def _takes_from_clouds_as(self, other: Surroundings) -> bool:
        """Whether what is taken from the clouds is the same: another object, perhaps, no more."""
        return (
            _same_clouds(self.snapshot, other.snapshot)
            and self.grid.cell_size == other.grid.cell_size
            and self.unknown == other.unknown
            and np.array_equal(self.kept, other.kept)
        )

    @property
    def flying(self) -> int:
        """How many points of the clouds are left out as flying pixels."""
        return sum(cloud.flying for cloud in self.clouds)

    def _kept_by_cloud(self) -> list[npt.NDArray[np.bool_]]:
        return np.split(self.kept, np.cumsum([len(cloud.points) for cloud in self.clouds])[:-1])

    def _contradictions(self) -> tuple[Disagreement, ...]:
        """Which of the topics' clouds contradict each other, by those points that are kept."""
        kept, snapshot = self._kept_by_cloud(), self.snapshot
        rows = [i for i, topic in enumerate(snapshot.topics) if topic]
        if len(rows) < 2:
            return ()
        return tuple(
            disagreements(
                [self.clouds[i].points[kept[i]] for i in rows],
                [snapshot.topics[i] for i in rows],
                [snapshot.times[i] for i in rows],
                snapshot.parameters["contact_tolerance"],
            )
        )

    def _sights(self) -> tuple[View, ...]:
        """Of each cloud whose sensor's place is known what it saw.

        Lines of sight that pass through the box around an object placed since tell nothing any
        more.
        """
        placed = [
            (cloud.points.min(axis=0), cloud.points.max(axis=0))
            for cloud in self.clouds
            if cloud.placed
        ]
        sights = []
        for cloud, hides in zip(self.clouds, self._kept_by_cloud(), strict=True):
            if cloud.origin is None:
                continue
            # the robot's points tell of unknown space what they do not hide; else they are left
            # out, so that a robot that moves makes no environment anew
            tells = np.ones(len(hides), np.bool_) if self.unknown else hides.copy()
            for lower, upper in placed:
                tells &= ~_passes(cloud.points, cloud.origin, lower, upper)
            sights.append(View(cloud.points[tells], cloud.origin, hides[tells]))
        return tuple(sights)

    def made_of(self, snapshot: Snapshot) -> bool:
        """Whether these are that snapshot's, as far as can be told at a glance."""
        return _same_inputs(snapshot, self.snapshot)

    def same(self, other: Surroundings) -> bool:
        """Whether both make the same environment."""
        return self is other or (
            self.same_scene(other)
            and self.near.same(other.near)
            and list(map(str, self.disagreements)) == list(map(str, other.disagreements))
            and (not self.sights or self.unknown == other.unknown)
            and (not self.sights or self.unknown_below == other.unknown_below)
            and (not (self.sights and self.unknown) or _same_hands(self.snapshot, other.snapshot))
        )

    def same_scene(self, other: Surroundings) -> bool:
        """Whether both environments are the same but for what robot and object make of them."""
        return self is other or (
            self.grid == other.grid
            and self.regions == other.regions
            and self.volume.same(other.volume)
            and self.beyond_volume == other.beyond_volume
            and _equal(self.bounds, other.bounds)
            and np.array_equal(self.points, other.points)
            and len(self.sights) == len(other.sights)
            and all(map(_same_view, self.sights, other.sights))
        )

    def scene(self) -> Environment:
        """The points preprocessed, which is the same for whatever is held.

        Raises:
            PlacementPlannerError: they are unusable.
        """
        return Environment.from_points(
            self.points,
            self.volume,
            self.grid,
            self.regions,
            self.bounds,
            sights=self.sights,
            beyond_volume=self.beyond_volume,
        )

    def environment(self, scene: Environment | None = None) -> Environment:
        """The scene with what is unknown and beside the robot, where that is.

        Args:
            scene: what `scene` says, where it is known already.

        Raises:
            PlacementPlannerError: the points are unusable.
        """
        parameters = self.snapshot.parameters
        around = max(parameters["self_filter.padding"], parameters["collision_margin"])

        def outside(centers: Array, distance: float) -> npt.NDArray[np.bool_]:
            return _outside(self.snapshot, centers, around + distance)

        made = self.scene() if scene is None else scene
        if self.unknown:
            made = made.with_unknown(self.unknown_below, outside)
        return made.with_disagreements(self.disagreements).with_near(self.near)


def _near(snapshot: Snapshot, points: Array) -> tuple[npt.NDArray[np.bool_], NearPoints]:
    """Which of points (n, 3) are not near the robot; of the others, what may be something else."""
    parameters, q = snapshot.parameters, snapshot.q_start
    padding = parameters["self_filter.padding"]
    robot = Outline.of_robot(snapshot.robot, q, padding, parameters.padding_of)
    held = held_outlines(snapshot.robot, q, snapshot.arms, snapshot.body, padding)
    clear = parameters.planner_settings.collision.clear
    kept, near = near_points(points, robot, held, clear, parameters.grid_settings)
    return kept, near.within(*_workspace(snapshot))


def _passes(points: Array, origin: Array, lower: Array, upper: Array) -> npt.NDArray[np.bool_]:
    """(n,) whether the line from a place to each point passes through a box and out of it again."""
    along = points - origin
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (lower - origin) / along, (upper - origin) / along
        enters = np.nanmax(np.minimum(first, second), axis=1)
        leaves = np.nanmin(np.maximum(first, second), axis=1)
    return np.asarray((enters < leaves) & (enters > 0.0) & (leaves < 1.0))


def _outside(snapshot: Snapshot, points: Array, distance: float) -> npt.NDArray[np.bool_]:
    return outside_robot(
        points, snapshot.robot, snapshot.q_start, snapshot.arms, snapshot.body, distance
    )


def _equal(some: tuple[Array, Array], others: tuple[Array, Array]) -> bool:
    return all(map(np.array_equal, some, others))


def _same_view(a: View, b: View) -> bool:
    return _equal((a.origin, a.points), (b.origin, b.points)) and np.array_equal(
        np.asarray(a.hides), np.asarray(b.hides)
    )


def _same_inputs(a: Snapshot, b: Snapshot) -> bool:
    names = (
        "target_volume",
        "cloud.cell_size",
        "max_slope",
        "clearance.beyond_volume",
        "self_filter.enabled",
        "unknown_space",
    )
    return (
        _same_clouds(a, b)
        and all(a.parameters[name] == b.parameters[name] for name in names)
        and _same_hands(a, b)
    )


def _same_clouds(a: Snapshot, b: Snapshot) -> bool:
    """Whether the clouds are, and what tells which of them contradict each other."""
    return (
        len(a.clouds) == len(b.clouds)
        and all(x is y for x, y in zip(a.clouds, b.clouds, strict=True))
        and a.placed == b.placed
        and a.topics == b.topics
        and a.times == b.times
        and all(map(np.array_equal, map(_known, a.origins), map(_known, b.origins)))
        and a.parameters["contact_tolerance"] == b.parameters["contact_tolerance"]
    )


def _known(origin: Array | None) -> Array:
    return np.empty(0) if origin is None else origin


def _same_hands(a: Snapshot, b: Snapshot) -> bool:
    """Whether robot and held object fill the same space."""
    names = ("self_filter.padding", "self_filter.padding_of", "collision_margin")
    return (
        a.robot is b.robot
        and a.body is b.body
        and np.array_equal(a.q_start, b.q_start)
        and [(arm.joints, arm.tip_frame, arm.grasps) for arm in a.arms]
        == [(arm.joints, arm.tip_frame, arm.grasps) for arm in b.arms]
        and all(a.parameters[name] == b.parameters[name] for name in names)
    )


def _workspace(snapshot: Snapshot) -> tuple[Array, Array]:
    return workspace(
        snapshot.robot,
        snapshot.arms,
        snapshot.q_start,
        snapshot.body,
        snapshot.parameters.volume,
    )


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
    around = cropped(*_workspace(snapshot), np.vstack(snapshot.clouds), settings.cell_size)
    if around is not None and too_many(*around):
        lower, upper = around
        size = " x ".join(f"{side:.3g}" for side in upper - lower)
        raise ParameterError(
            "cloud.cell_size",
            settings.cell_size,
            f"makes more than {settings.max_cells} cells of the {size} m that are of interest; "
            "set it higher, or a target_volume nearer to the robot",
        )


def disagreement_notes(environment: Environment | None) -> list[str]:
    """Which clouds contradict each other.

    Args:
        environment: the run's; None where it is yet to be made.
    """
    found = () if environment is None else environment.disagreements
    return [
        f"clouds disagree: {each}, over a patch that both see; nothing is put down there where "
        "that is more than contact_tolerance and noise: calibrate the cameras"
        for each in found
    ]


def sight_notes(snapshot: Snapshot, environment: Environment | None) -> list[str]:
    """What to tell of `unknown_space`: how much of V was seen, or that nobody can tell; and where
    V lies below a ceiling that nobody saw, what to do about it.

    Args:
        environment: the run's; None where it is yet to be made.
    """
    asked = snapshot.parameters["unknown_space"]
    if asked == "free":
        if environment is None or not environment.has_unseen_ceiling:
            return []
        return [
            "target_volume lies in a compartment whose ceiling no sensor has seen, and motions may "
            "meet it: set unknown_space to occupied_below, or keep_out to where the ceiling is"
        ]
    if all(origin is None for origin in snapshot.origins):
        return [
            f"unknown_space: {asked} has no effect, for nobody knows where any cloud was seen "
            "from; publish organised clouds in their optical frame, or name their frame in "
            "sensor_frames"
        ]
    if environment is None or environment.seen is None:
        return []
    upto = " up to the highest thing measured" if asked == "occupied_below" else ""
    return [
        f"the sensors have seen {environment.seen:.0%} of target_volume; with unknown_space: "
        f"{asked} the rest counts as occupied{upto}"
    ]
