"""What stands in the way at poses that were refused: looked at again, a few of them, afterwards."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from placement_planner_ros.core.collision.arm import (
    ENVIRONMENT,
    HELD_OBJECT,
    CollisionSettings,
    Meeting,
)
from placement_planner_ros.core.collision.object import ObjectCollision
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.explanation import surfaces
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.sample_goals.rejections import RejectedPose
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.keep_out import inside
from placement_planner_ros.core.scene.region_points import RegionPoints
from placement_planner_ros.core.stability.support_settings import SupportSettings
from placement_planner_ros.core.types import Array, Verdict

_IN_DOUBT = "what too few noisy points show"
"""Said of surfaces that nothing stands on for that."""
_GAP = 0.01
"""m of height, at least, under what hangs over something."""
_POSES = 32
"""Poses of one kind that are looked at again."""
_SEEDS = 16
"""Starts of the inverse kinematics for each."""
_BOXES = 32
"""Boxes looked at of those that the object meets at a pose."""
_STEPS = 40
"""Configurations looked at on a straight way."""
_DRAWN = 400
"""Poses drawn to see whether others would stand."""
_CONFIGURATIONS = 1
"""Configurations looked at for each."""


@dataclass(frozen=True, slots=True)
class Met:
    """What was met at poses looked at again.

    Attributes:
        looked: how many were, configurations or where the object alone is looked at poses.
        most: what meets what most often, and how often; '' where nothing was seen to.
        times: how often.
        where: (3,) m, the middle of the places where it did.
        unseen: how many met nothing but space that no sensor has seen.
        poses: how many poses were.
        spared: how many of these would be free with a collision_margin of 0.
        above: for the object alone, how many met nothing but what hangs over its support.
        kept_out: how many met nothing but boxes of keep_out.
    """

    looked: int
    most: str = ""
    times: int = 0
    where: tuple[float, float, float] = (0.0, 0.0, 0.0)
    unseen: int = 0
    poses: int = 0
    spared: int = 0
    above: int = 0
    kept_out: int = 0

    def __str__(self) -> str:
        if not self.most:
            return f"nothing certain was seen in {self.looked} looked at again"
        x, y, z = self.where
        return (
            f"in {self.times} of {self.looked} looked at again {self.most}, about "
            f"({x:.2f}, {y:.2f}, {z:.2f})"
        )


def met_by_arm(
    holdings: Sequence[Holding], poses: Sequence[RejectedPose], environment: Environment
) -> Met:
    """Which link meets what most often where these were to be reached."""
    rng = np.random.default_rng(0)
    meetings: list[Meeting] = []
    unseen, spared, kept_out = 0, 0, 0
    looked = thinned(poses)
    for pose in looked:
        holding, T = holdings[pose.holding], pose.T_world_object
        candidates = holding.candidates(T, _SEEDS, rng)
        for q in candidates[:_CONFIGURATIONS]:
            met = holding.meeting(q, T)
            if met is not None:
                meetings.append(met)
                unseen += met.box >= 0 and is_unseen(environment, met.box)
                kept_out += met.box >= 0 and is_kept_out(environment, met.box)
        exact = replace(holding.collision.settings, collision_margin=0.0)
        bare = holding.collision.with_pairs(lambda a, b: True, exact)
        if not holding.collision.free_batch(candidates, contact=True).any():
            spared += bool(bare.free_batch(candidates, contact=True).any())
    found = _counted(meetings, unseen)
    return replace(found, poses=len(looked), spared=spared, kept_out=kept_out)


def met_on_the_way(holding: Holding, goals: Sequence[Array]) -> Met:
    """What is met first on the straight ways of the joints from q_0 to goals (dof,)."""
    meetings = []
    for goal in goals:
        for share in np.linspace(0.0, 1.0, _STEPS + 1)[1:]:
            q = holding.q_start + share * (goal - holding.q_start)
            found = holding.collision.meeting(q)
            if found is not None:
                meetings.append(found)
                break
    return replace(_counted(meetings, 0), looked=len(goals))


def met_by_object(
    problem: Problem,
    settings: CollisionSettings,
    raise_height: float,
    poses: Sequence[RejectedPose],
) -> Met:
    """What the object itself meets at poses and on its way down to them."""
    body, environment = problem.body, problem.environment
    exact = replace(settings, collision_margin=0.0)
    object_ = ObjectCollision(body, environment.obstacles, settings)
    bare = ObjectCollision(body, environment.obstacles, exact)
    meetings, unseen, above, spared, kept_out = [], 0, 0, 0, 0
    looked = thinned(poses)
    for pose in looked:
        T = pose.T_world_object.homogeneous
        boxes = object_.met(T, pose.contact_height, raise_height, pose.slope)[:_BOXES]
        spared += bare.free(T, pose.contact_height, raise_height, pose.slope)
        if len(boxes) == 0:
            continue
        seen = [box for box in boxes.tolist() if not is_unseen(environment, box)]
        unseen += not seen
        lower, upper = environment.obstacles.lower, environment.obstacles.upper
        middle = (lower[boxes] + upper[boxes]).mean(axis=0) / 2.0
        over = all(_overhangs(environment, box, pose) for box in boxes.tolist())
        above += over
        what = "what stands above it" if over else "what stands beside it"
        what = what if seen else "space that no sensor has seen"
        kept_out += (barred := all(is_kept_out(environment, box) for box in boxes.tolist()))
        what = "a box of keep_out" if barred else what
        what = _IN_DOUBT if all(_in_doubt(environment, box) for box in boxes.tolist()) else what
        meetings.append(Meeting(HELD_OBJECT, what, middle))
    return replace(
        _counted(meetings, unseen),
        looked=len(looked),
        poses=len(looked),
        above=above,
        spared=spared,
        kept_out=kept_out,
    )


def stable_with(
    problem: Problem, footing: SupportSettings, rejected: Sequence[RejectedPose]
) -> int:
    """How many of the poses without support would have it by these settings."""
    other = PoseConstraints(problem, CollisionSettings(), footing, 0.0)
    return sum(other.stable(pose.T_world_object, pose.face, pose.slope) for pose in rejected)


def standing_by_polygon(
    problem: Problem, settings: CollisionSettings, footing: SupportSettings, raise_height: float
) -> tuple[int, int]:
    """Of how many poses drawn at random how many would stand free, supported by polygon."""
    by_polygon = replace(footing, support="polygon")
    poses = PoseConstraints(problem, settings, by_polygon, raise_height)
    if not poses.regions:
        return 0, 0
    rng = np.random.default_rng(0)
    points = RegionPoints(poses.regions)
    drawn = rng.integers(len(poses.regions), size=_DRAWN)
    faces = rng.integers(len(problem.body.faces), size=_DRAWN)
    angles = rng.uniform(0.0, 2.0 * np.pi, _DRAWN)
    verdicts, _ = poses.verdicts(faces, points.sample(drawn, rng), angles, points.slopes[drawn])
    return _DRAWN, int((verdicts == Verdict.FEASIBLE).sum())


def is_unseen(environment: Environment, box: int) -> bool:
    """Whether a box of the obstacle set is space that no sensor has seen."""
    measured = environment.measured
    if measured is environment.obstacles:
        return False
    obstacles = environment.obstacles
    if obstacles.barred is not None and obstacles.barred[box]:
        return False
    shift = np.round((obstacles.origin - measured.origin) / obstacles.cell_size).astype(np.int64)
    at = obstacles.cells[box] + shift  # its grid may reach farther than what was measured
    within = (at >= 0).all() and (at < measured.shape).all()
    return not within or bool(measured.number_at[tuple(at)] == 0)


def is_kept_out(environment: Environment, box: int) -> bool:
    """Whether a box of the obstacle set belongs to one to keep out of."""
    obstacles = environment.obstacles
    if not len(environment.keep_out) or obstacles.barred is None or not obstacles.barred[box]:
        return False
    middle = 0.5 * (obstacles.lower[box] + obstacles.upper[box])
    return bool(inside(middle, environment.keep_out))


def _in_doubt(environment: Environment, box: int) -> bool:
    """Whether too few noisy points show a box to stand on it."""
    barred = environment.obstacles.barred
    return barred is not None and bool(barred[box]) and not is_kept_out(environment, box)


def _overhangs(environment: Environment, box: int, pose: RejectedPose) -> bool:
    """Whether there is a gap between the contact plane and the lowest thing above it there."""
    obstacles = environment.obstacles
    middle = 0.5 * (obstacles.lower[box] + obstacles.upper[box])
    floor = pose.contact_height + float(middle[:2] @ pose.slope) + _GAP
    i, j, _ = obstacles.cells[box].tolist()
    here = [k for k in surfaces.column(obstacles, i, j) if obstacles.upper[k, 2] > floor]
    return all(obstacles.lower[k, 2] > floor for k in here)


def thinned(poses: Sequence[RejectedPose]) -> list[RejectedPose]:
    """So many as are looked at again, evenly chosen."""
    every = list(poses)
    return every[:: max(1, -(-len(every) // _POSES))]


def _counted(meetings: Sequence[Meeting], unseen: int) -> Met:
    if not meetings:
        return Met(0)
    names = Counter((m.first, m.second) for m in meetings)
    (first, second), times = names.most_common(1)[0]
    places = np.array([m.where for m in meetings if (m.first, m.second) == (first, second)])
    x, y, z = np.median(places, axis=0).tolist()
    if second == ENVIRONMENT and 2 * unseen > times:
        second = "space that no sensor has seen"
    return Met(len(meetings), f"{first} meets {second}", times, (x, y, z), unseen)
