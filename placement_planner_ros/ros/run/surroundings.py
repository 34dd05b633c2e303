"""From the clouds of a snapshot to the environment, without the robot and the held object."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from placement_planner_ros.core.collision.mesh_distances import rows_in_boxes
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.problem import workspace
from placement_planner_ros.core.scene.cloud import STEP_M, crop_cloud, thinned
from placement_planner_ros.core.scene.cloud_agreement import Disagreement, disagreements
from placement_planner_ros.core.scene.environment import Environment, require_room
from placement_planner_ros.core.scene.flying_pixels import flying_pixels
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.scene.near_points import NearPoints
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array, Index, Mask
from placement_planner_ros.ros.inputs.camera_shift import camera_shift
from placement_planner_ros.ros.inputs.cloud_store import PointSet
from placement_planner_ros.ros.inputs.joint_past import JITTER
from placement_planner_ros.ros.inputs.self_filter import (
    Outline,
    held_outlines,
    near_points,
    outside_robot,
)
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.run.snapshot import Snapshot

_MAKE_SCENE = ("cloud.cell_size", "max_slope", "target_volume", "clearance.beyond_volume")
"""Parameters on which a scene depends, """
_MAKE_ENVIRONMENT = (
    *_MAKE_SCENE,
    "self_filter.padding",
    "self_filter.padding_of",
    "self_filter.enabled",
    "collision_margin",
    "contact_tolerance",
    "unknown_space",
)
"""and on which an environment does."""
_SPARSE_SHARE = 0.2
"""Share of a surface that is worth a word when it is lost."""


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """All that an environment is made from.

    Attributes:
        snapshot: the inputs.
        points: (n, 3) neither near the robot nor near the held object, nor flying, planning frame.
        near: of those that are near, what may be something else.
        error: how far a cloud is off the robot that it shows at most, metres.
        bounds: lower (3,) and upper (3,) corner of the workspace.
        sights: of clouds whose sensor's place is known, without flying pixels.
        disagreements: of clouds whose heights contradict each other.
        clouds: which points of each are real, by what tells one cloud of this snapshot from others.
    """

    snapshot: Snapshot
    points: Array
    near: NearPoints
    error: float
    bounds: tuple[Array, Array]
    sights: tuple[View, ...]
    disagreements: tuple[Disagreement, ...]
    clouds: dict[object, Index]

    @classmethod
    def of(cls, snapshot: Snapshot, before: Surroundings | None = None) -> Surroundings:
        """Filter the robot and what it holds out of the clouds.

        Args:
            before: what was made of an earlier snapshot; returned where nothing has changed.
        """
        if before is not None and have_same_inputs(before.snapshot, snapshot):
            return before
        size = snapshot.parameters.grid_settings.cell_size
        known = {} if before is None else before.clouds
        # flying pixels take longest to tell, so they are remembered for each cloud
        keys = [(id(part.points), part.eye, part.placed, size) for part in snapshot.parts]
        clouds: dict[object, Index] = {
            key: known[key] if key in known else _real_points(part, size)
            for key, part in zip(keys, snapshot.parts, strict=True)
        }
        parts = [(p, p.points[clouds[key]]) for key, p in zip(keys, snapshot.parts, strict=True)]
        points = np.vstack([real for _, real in parts])
        # what the robot and the object in its hand cover is left out of what sensors saw
        kept, near, error = np.ones(len(points), np.bool_), NearPoints(), 0.0
        if snapshot.parameters["self_filter.enabled"]:
            measured = [np.full(len(real), not part.placed) for part, real in parts]
            rows = np.flatnonzero(np.concatenate(measured))
            of_sensors = [real for part, real in parts if not part.placed]
            kept[rows], near, error = _beside_robot(snapshot, of_sensors)
        # and of each cloud by itself, for its lines of sight and its heights
        split = np.split(kept, np.cumsum([len(real) for _, real in parts])[:-1])
        each = [(*part, hides) for part, hides in zip(parts, split, strict=True)]
        return cls(
            snapshot,
            points[kept],
            near,
            error,
            _workspace(snapshot),
            _sights(snapshot, each),
            _disagreements(snapshot, each),
            clouds,
        )

    def same_scene(self, other: Surroundings) -> bool:
        """Whether both environments are the same but for what robot and object make of them."""
        mine, its = self.snapshot.parameters, other.snapshot.parameters
        return (
            all(mine[name] == its[name] for name in _MAKE_SCENE)
            and len(self._arrays) == len(other._arrays)
            and all(map(np.array_equal, self._arrays, other._arrays))
        )

    @property
    def _arrays(self) -> list[Any]:
        """What must be equal, element by element."""
        sights = [array for view in self.sights for array in (view.origin, view.points, view.hides)]
        return [*self.bounds, self.points, *sights]

    def scene(self) -> Environment:
        """The points preprocessed, which is the same for whatever is held.

        Raises:
            PlacementPlannerError: they are unusable.
        """
        parameters, points = self.snapshot.parameters, self.points
        noise: float | None = None
        # what is known comes last; such points would make the whole pass for free of noise, so
        # those of sensors are projected onto their surfaces before they are joined
        known = sum(len(part.points) for part in self.snapshot.parts if part.placed)
        if 0 < known < len(points):
            sensed, exact = np.split(points, [len(points) - known])
            measured = ObstacleSet.from_points(sensed, parameters.grid_settings, self.bounds)
            points, noise = np.vstack([measured.points, exact]), measured.noise
        return Environment.from_points(
            points,
            parameters.volume,
            parameters.grid_settings,
            parameters.region_settings,
            self.bounds,
            sights=self.sights,
            beyond_volume=parameters["clearance.beyond_volume"],
            noise=noise,
        )

    def environment(self, scene: Environment | None = None) -> Environment:
        """The scene with what is unknown and beside the robot, where that is.

        Args:
            scene: what `scene` says, where it is known already.

        Raises:
            PlacementPlannerError: the points are unusable.
        """
        snapshot, parameters = self.snapshot, self.snapshot.parameters
        robot, q, arms, body = snapshot.robot, snapshot.q_start, snapshot.arms, snapshot.body
        margin = settings_for(parameters, self.error).collision.obstacle_margin
        around = max(parameters["self_filter.padding"], margin)
        # what no sensor saw is occupied, but around robot and object, which would start in it
        made = self.scene() if scene is None else scene
        if parameters["unknown_space"] != "free":
            made = made.with_unknown(
                parameters["unknown_space"] == "occupied_below",
                lambda centers, distance: outside_robot(
                    centers, robot, q, arms, body, around + distance
                ),
            )
        return made.with_disagreements(self.disagreements).with_near(self.near, self.error)


def settings_for(parameters: ParameterSet, error: float) -> PlannerSettings:
    """The planner's settings where obstacles may be off by so many metres."""
    settings = parameters.planner_settings
    return replace(settings, collision=replace(settings.collision, obstacle_error=error))


def _beside_robot(snapshot: Snapshot, clouds: list[Array]) -> tuple[Mask, NearPoints, float]:
    """Which of the points (n, 3) of clouds are not near the robot, one cloud after the other; of
    the others, what may be something else. Each cloud is laid on the robot that it shows; by how
    many metres at most."""
    parameters, q = snapshot.parameters, snapshot.q_start
    padding = parameters["self_filter.padding"]
    robot = Outline.of_robot(snapshot.robot, q, padding, parameters.padding_of)
    held = held_outlines(snapshot.robot, q, snapshot.arms, snapshot.body, padding)
    # each cloud is moved to where the robot that it shows is
    shifts = np.reshape([camera_shift(robot, each) for each in clouds], (-1, 3))
    points = np.vstack([np.zeros((0, 3)), *map(np.subtract, clouds, shifts)])
    error = float(np.linalg.norm(shifts, axis=1).max(initial=0.0))
    clear = settings_for(parameters, error).collision.clear
    kept, near = near_points(points, robot, held, clear, parameters.grid_settings, error)
    return kept, near.within(*_workspace(snapshot)), error


def _real_points(part: PointSet, size: float) -> Index:
    """Which points of a cloud are no flying pixels, no denser than cells of that size need; what is
    known is all real."""
    rows = np.arange(len(part.points))
    if part.placed:
        return rows
    step("thinning the clouds")
    # without a sensor's place nobody can tell flying pixels
    if part.origin is not None:
        rows = rows[~flying_pixels(part.points, part.origin)]
    return rows[thinned(part.points[rows], size)]


_Filtered = tuple[PointSet, Array, Mask]
"""A part of a snapshot, what is real of it, (n, 3), and which of these the robot does not carry."""


def _disagreements(snapshot: Snapshot, each: list[_Filtered]) -> tuple[Disagreement, ...]:
    """Which of the topics' clouds contradict each other, by points that are kept."""
    # what is known or accumulated has no topic, and contradicts nobody; nor does what is far away
    of_topics = [(part, real[kept]) for part, real, kept in each if part.topic]
    if len(of_topics) < 2:
        return ()
    lower, upper = _workspace(snapshot)
    box = np.array([[0.5 * (lower + upper), 0.5 * (upper - lower)]])
    return tuple(
        disagreements(
            [points[rows_in_boxes(points, box)] for _, points in of_topics],
            [part.topic for part, _ in of_topics],
            [part.time for part, _ in of_topics],
            snapshot.parameters["contact_tolerance"],
        )
    )


def _sights(snapshot: Snapshot, each: list[_Filtered]) -> tuple[View, ...]:
    """Of each cloud whose sensor's place is known what it saw.

    Lines of sight that pass through the box around an object placed since tell nothing any more.
    """
    # a line through an object placed since was free before it stood there
    placed = [(real.min(axis=0), real.max(axis=0)) for part, real, _ in each if part.placed]
    sights, unknown = [], snapshot.parameters["unknown_space"] != "free"
    for part, real, hides in each:
        if part.origin is None:
            continue
        # the robot's points tell of unknown space what they do not hide; else they are left out, so
        # that a robot that moves makes no environment anew
        tells = np.ones(len(hides), np.bool_) if unknown else hides.copy()
        for lower, upper in placed:
            tells &= ~_passes_through(real, part.origin, lower, upper)
        sights.append(View(real[tells], part.origin, hides[tells]))
    return tuple(sights)


def _passes_through(points: Array, origin: Array, lower: Array, upper: Array) -> Mask:
    """(n,) whether the line from a place to each point passes through a box and out of it again."""
    along = points - origin
    with np.errstate(divide="ignore", invalid="ignore"):
        # shares of the way at which the line meets the planes of the box, axis by axis
        first, second = (lower - origin) / along, (upper - origin) / along
        enters = np.nanmax(np.minimum(first, second), axis=1)
        leaves = np.nanmin(np.maximum(first, second), axis=1)
    return np.asarray((enters < leaves) & (enters > 0.0) & (leaves < 1.0))


def have_same_inputs(a: Snapshot, b: Snapshot) -> bool:
    """Whether both make the same environment, as far as can be told at a glance."""
    mine, its = (
        [
            [(part.topic, part.time) for part in each.parts],
            [(arm.joints, arm.tip_frame, arm.grasps) for arm in each.arms],
        ]
        for each in (a, b)
    )
    return (
        mine == its
        and all(x.same(y) for x, y in zip(a.parts, b.parts, strict=True))
        and all(a.parameters[name] == b.parameters[name] for name in _MAKE_ENVIRONMENT)
        and a.robot is b.robot
        and a.body is b.body
        and bool((np.abs(a.q_start - b.q_start) <= JITTER).all())
    )


def _workspace(snapshot: Snapshot) -> tuple[Array, Array]:
    volume = snapshot.parameters.volume
    return workspace(snapshot.robot, snapshot.arms, snapshot.q_start, snapshot.body, volume)


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
    # what was measured may be smaller than the workspace
    volume = snapshot.parameters.volume
    cloud = crop_cloud(
        np.vstack(snapshot.clouds),
        _workspace(snapshot),
        (volume.lower, volume.upper),
        settings.cell_size,
    )
    if too_many(*cloud.held):
        lower, upper = cloud.held
        size = " x ".join(f"{side:.3g}" for side in upper - lower)
        raise ParameterError(
            "cloud.cell_size",
            settings.cell_size,
            f"makes more than {settings.max_cells} cells of the {size} m that the arms' reach "
            "and target_volume span; set it higher, or where the latter is far away, that nearer",
        )


def environment_notes(snapshot: Snapshot, environment: Environment | None) -> list[str]:
    """Which clouds contradict each other, whether they are too sparse, and what to tell of
    `unknown_space`: that nobody can tell what was seen; and where V lies below a
    ceiling that nobody saw, what to do about it.

    Args:
        environment: the run's; None where it is yet to be made.
    """
    least = max(snapshot.parameters["contact_tolerance"], STEP_M)
    notes = [
        f"clouds disagree: {each}, over a patch that both see; nothing is put down there where "
        f"that is more than {least:g} m and noise: calibrate the cameras"
        for each in (() if environment is None else environment.disagreements)
    ]
    if environment is not None and environment.error:
        notes.append(
            f"a cloud shows the robot {environment.error:.2g} m from where its joints say, and "
            "motions keep that much beyond collision_margin from all things: calibrate the cameras"
        )
    if environment is not None and environment.sparse > _SPARSE_SHARE:
        notes.append(
            f"points are so far apart that {environment.sparse:.0%} of the largest surface in "
            "target_volume is not used: holes may lie between them, and no line of sight tells "
            "that there are none; give denser clouds, or publish organised ones in their optical "
            "frame, or name their frame in sensor_frames"
        )
    asked = snapshot.parameters["unknown_space"]
    if asked == "free" and environment is not None and environment.has_unseen_ceiling:
        notes.append(
            "target_volume lies in a compartment whose ceiling no sensor has seen, and motions may "
            "meet it: set unknown_space to occupied_below, or keep_out to where the ceiling is"
        )
    elif asked != "free" and all(part.origin is None for part in snapshot.parts):
        notes.append(
            f"unknown_space: {asked} has no effect, for nobody knows where any cloud was seen "
            "from; publish organised clouds in their optical frame, or name their frame in "
            "sensor_frames"
        )
    return notes
