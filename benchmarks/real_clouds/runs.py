"""Every bundled object placed on the table of a real cloud, held against its points."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial import KDTree

from benchmarks.cases import build_problem, inputs_of
from benchmarks.household import object_by_name
from benchmarks.real_clouds.table import TableCloud
from benchmarks.record import RecordedRun
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.scene.freespace import View

_ROBOT = 0.12
"""m ahead of the robot's middle within which points are taken to be its own."""


@dataclass(frozen=True, slots=True, eq=False)
class RealRun:
    """What became of one object on one cloud.

    Attributes:
        pose: T_world_object of the last placement; None where there is none.
        seconds: of processor time to the first, the environment's construction included.
        deepest: m that any measured point lies inside of the object, noise of the table included.
        farthest: m from a vertex that the object stands on to the nearest measured point.
    """

    thing: str
    pose: pin.SE3 | None
    seconds: float
    failure: str = ""
    deepest: float = 0.0
    farthest: float = 0.0


def place_on(cloud: TableCloud, thing: str, seconds: float, seed: int) -> RealRun:
    """Plan for one object, for so many seconds of processor time or until the second placement."""
    points = cloud.points[cloud.points[:, 0] > _ROBOT]
    inputs = inputs_of(thing, cloud.volume, points)
    run, started = RecordedRun(seed, seconds), time.process_time()
    sights = [View(points, cloud.sensor)]
    problem, objective = build_problem(
        inputs, "maximize_clearance", sights=sights, beyond_volume=True
    )
    rng = np.random.default_rng(seed)
    planner = PlacementPlanner(problem, objective, PlannerSettings(), rng)
    pose = None
    for placement in run.follow(planner, started):
        pose = placement.T_world_object
        if len(run.solutions) == 2:
            break
    if pose is None:
        return RealRun(thing, None, 0.0, run.failure)
    return RealRun(thing, pose, run.solutions[0].time, "", *_depth_and_gap(points, thing, pose))


def _depth_and_gap(points: np.ndarray, thing: str, pose: pin.SE3) -> tuple[float, float]:
    """`deepest` and `farthest` of an object at a pose."""
    held = object_by_name(thing)
    seen = (points - pose.translation) @ pose.rotation
    around = (np.abs(points - pose.translation) < 0.3).all(axis=1)
    seen = seen[around]
    deepest = max(float(part.depth(seen).max(initial=0.0)) for part in held.parts)
    vertices = held.vertices @ pose.rotation.T + pose.translation
    feet = vertices[vertices[:, 2] < vertices[:, 2].min() + 1e-3]
    return deepest, float(KDTree(points[around]).query(feet)[0].max())
