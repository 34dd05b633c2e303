"""What is measured of one robot, in a process of its own, told as JSON lines."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.robots.agreement import RobotFiles, clutter, compare, small_boxes_inside
from benchmarks.robots.subject import Subject, read_subject
from benchmarks.robots.things import (
    CLOUDS,
    OBJECTS,
    boxes_at_start,
    object_of,
    observe,
    outside_boxes,
    table_for,
)
from benchmarks.situations.observing import Observation
from benchmarks.speed.searches import _TimedSampler
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import ArmCollision, CollisionSettings
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.disk_cache import cache_folder
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem, workspace
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.flying_pixels import flying_pixels
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.scene.visibility import View
from placement_planner_ros.core.types import Array, Placement
from placement_planner_ros.core.warmup import warm_up

Entry = dict[str, Any]
ROWS = ("first", "edges", "collision", "samples", "node", "agreement")
_TESTS = Path(__file__).resolve().parents[2] / "test"
_SEEDS = 3
_LIMIT = 10.0
"""s of processor time for a first placement."""
_MORE = 1.0
"""s of processor time that a run goes on after it."""
_EDGES, _EDGE, _BESIDE = 400, 0.5, 0.030
"""Edges, their length in rad, and how near to contact half of them begin, m."""
_TRIES = 100_000
_SAMPLING = 2.0
_REPEATS = 5
_RUNS = 10
_WARM = 300.0
_REACH = 1.5
"""m, no point of an arm moves further for one rad."""


def problem_of(subject: Subject, name: str, seen: Observation) -> Problem:
    """The problem with one of `OBJECTS`.

    What a camera does not see is occupied up to the highest that it saw (`unknown_space:
    occupied_below`), but where the robot and its object are at the start: only so can what is
    published be held to the true solids.
    """
    sights = tuple(
        View(view.points[~flying_pixels(view.points, view.origin)], view.origin)
        for view in seen.sights
    )
    points = np.vstack([view.points for view in sights]) if sights else seen.points
    body = Body.from_mesh(*object_of(subject, name))
    robot, arms, q, volume = subject.robot, subject.arms, subject.q_start, subject.volume
    # As the node has it: of the workspace, what points lie in.
    lower, upper = workspace(robot, arms, q, body, volume)
    within = points[((points >= lower) & (points <= upper)).all(axis=1)]
    rim = 2.0 * GridSettings().cell_size
    bounds = (
        np.maximum(lower, within.min(axis=0) - rim),
        np.minimum(upper, within.max(axis=0) + rim),
    )
    environment = Environment.from_points(
        points,
        volume,
        GridSettings(),
        RegionSettings(),
        bounds,
        views=sights,
        outside_robot=partial(outside_boxes, boxes_at_start(subject)),
        unknown_below=True,
        beyond_volume=False,
    )
    return Problem(robot, arms, q, body, volume, environment)


def planner_of(problem: Problem, rng: np.random.Generator) -> PlacementPlanner:
    """With the node's default objective and settings."""
    context = ObjectiveContext(problem.environment, problem.volume, problem.body)
    objective = make_objective("maximize_clearance", context)
    return PlacementPlanner(problem, objective, PlannerSettings(), rng)


def measure_first(subject: Subject) -> Iterator[Entry]:
    """First placements, in processor time from the cloud on, and what the checker says of all."""
    runs = 0
    for name in OBJECTS:
        for cloud in CLOUDS:
            for seed in range(_SEEDS):
                rng = np.random.default_rng(seed)
                scene = table_for(subject, np.random.default_rng(seed))
                seen = observe(scene, cloud, rng)
                entry: Entry = {"row": "first", "object": name, "cloud": cloud, "seed": seed}
                found: list[Placement] = []
                began, first, failure = time.process_time(), _LIMIT, ""
                problem = None
                try:
                    problem = problem_of(subject, name, seen)
                    planner = planner_of(problem, rng)
                    until = began + _LIMIT
                    for placement in planner.run(lambda: time.process_time() > until):  # noqa: B023
                        if not found:
                            first = time.process_time() - began
                            until = time.process_time() + _MORE
                        found.append(placement)
                    failure = "" if found else planner.explain().cause
                except PlacementPlannerError as error:
                    failure = f"{error.code}: {error}"
                entry |= {"seconds": first, "solutions": len(found), "failure": failure}
                runs += 1
                if runs == _RUNS:
                    entry["megabytes"] = _resident()
                if problem is not None:
                    entry["refused"] = _refused(subject, scene, name, problem, found)
                yield entry


def _resident() -> float:
    """Of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    return pages * resource.getpagesize() / 1e6


def _refused(
    subject: Subject, scene: Any, name: str, problem: Problem, found: Sequence[Placement]
) -> list[str] | None:
    """What the checker says; None where there is no checkout with it."""
    if not (_TESTS / "checker").exists():
        return None
    if str(_TESTS) not in sys.path:
        sys.path.append(str(_TESTS))
    checker: Any = importlib.import_module("checker")
    pairs = "".join(
        f'<disable_collisions link1="{a}" link2="{b}"/>' for a, b in subject.robot.allowed_pairs
    )
    vertices, triangles = object_of(subject, name)
    obstacles = problem.environment.measured
    mimics = subject.robot.mimics
    start = zip(subject.robot.joint_names, subject.q_start.tolist(), strict=True)
    packages = {
        folder.name: folder
        for each in subject.package_dirs
        for folder in each.iterdir()
        if folder.is_dir() and f"package://{folder.name}/" in subject.urdf
    }
    task = checker.Task(
        scene.parts,
        subject.volume.boxes[:, 0],
        subject.volume.boxes[:, 1],
        vertices,
        triangles,
        problem.body.center_of_mass,
        subject.urdf,
        f"<robot>{pairs}</robot>",
        packages,
        {joint: value for joint, value in start if joint not in mimics},
        "none",
        np.array([obstacles.lower, obstacles.upper]),
    )
    judge = checker.SolutionChecker(task)
    refused, previous = [], None
    for placement in found:
        arm = next(arm for arm in subject.arms if arm.name == placement.goal.arm)
        refused += judge.check(checker.Solution.of(placement, arm), previous)
        previous = placement.objective
    return refused


def edges_of(
    subject: Subject, rng: np.random.Generator
) -> tuple[ArmCollision, list[tuple[Array, Array]]]:
    """An arm with the object in hand among clutter, and free starts of edges with their ends."""
    arm = subject.arms[0]
    obstacles = clutter(subject.robot, arm, subject.q_start, 20, rng)
    body = Body.from_mesh(subject.vertices, subject.triangles)
    moving = MovingArm(subject.robot, arm, subject.q_start)
    collision = ArmCollision(moving, AttachedObject(body, 0), obstacles)
    edges: list[tuple[Array, Array]] = []
    for _ in range(_TRIES):
        if len(edges) == _EDGES:
            break
        q = rng.uniform(arm.lower, arm.upper)
        if not collision.free(q):
            continue
        if len(edges) % 2:  # up to a collision, and a little back
            other = rng.uniform(arm.lower, arm.upper)
            if collision.free(other):
                continue
            for _ in range(14):
                middle = (q + other) / 2.0
                q, other = (middle, other) if collision.free(middle) else (q, middle)
            back = rng.normal(size=arm.dof)
            back *= _BESIDE * rng.random() / (_REACH * np.abs(back).sum())
            q = np.clip(q + back, arm.lower, arm.upper)
            if not collision.free(q):
                continue
        way = rng.normal(size=arm.dof)
        edges.append((q, np.clip(q + _EDGE * way / np.linalg.norm(way), arm.lower, arm.upper)))
    return collision, edges


def measure_edges(subject: Subject, beside: Subject) -> Iterator[Entry]:
    """Mean time of edges, certified and refused apart, and those of another robot meanwhile."""
    made = [edges_of(each, np.random.default_rng(0)) for each in (subject, beside)]
    times: list[dict[bool, list[float]]] = [{True: [], False: []} for _ in made]
    for k in range(min(len(edges) for _, edges in made)):
        for (collision, edges), seconds in zip(made, times, strict=True):
            began = time.thread_time()
            free = collision.edge_free(*edges[k])
            seconds[free].append(time.thread_time() - began)
    entry: Entry = {"row": "edges", "beside": beside.name}
    for who, seconds in zip(("own", "other"), times, strict=True):
        for free, word in ((True, "certified"), (False, "refused")):
            entry[f"{who}_{word}"] = float(np.mean(seconds[free])) if seconds[free] else None
            entry[f"{who}_{word}_number"] = len(seconds[free])
    yield entry


def measure_collision(subject: Subject) -> Iterator[Entry]:
    """Seconds of processor time that the collision checker of an arm takes to make."""
    rng = np.random.default_rng(0)
    arm = subject.arms[0]
    obstacles = clutter(subject.robot, arm, subject.q_start, 20, rng)
    box_arrays(obstacles)  # of the environment, like a node's
    bodies = [Body.from_mesh(*object_of(subject, name)) for name in OBJECTS]
    seconds = []
    for k in range(1 + _REPEATS):
        held = AttachedObject(Body.from_mesh(bodies[k % 2].vertices, bodies[k % 2].triangles), 0)
        began = time.process_time()
        ArmCollision(MovingArm(subject.robot, arm, subject.q_start), held, obstacles)
        seconds.append(time.process_time() - began)
    yield {"row": "collision", "first": seconds[0], "again": float(np.median(seconds[1:]))}


def measure_samples(subject: Subject) -> Iterator[Entry]:
    """Goal samples per second of processor time spent on them."""
    rng = np.random.default_rng(0)
    scene = table_for(subject, np.random.default_rng(0))
    problem = problem_of(subject, OBJECTS[0], observe(scene, CLOUDS[0], rng))
    planner = planner_of(problem, rng)
    timed = planner.sampler = _TimedSampler(planner.sampler)
    until = time.process_time() + _SAMPLING
    for _ in planner.run(lambda: time.process_time() > until):
        pass
    yield {"row": "samples", "samples": planner.statistics.samples, "seconds": timed.seconds}


def measure_node(subject: Subject) -> Iterator[Entry]:
    """Seconds from the start of the node's process to `warm`, without and with covers on disk.

    By the clock, and of processor time, which other work on the machine changes little.
    """
    if importlib.util.find_spec("rclpy") is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        known = cache_folder()
        for each in known.iterdir() if known is not None and known.is_dir() else ():
            if _KERNELS.search(each.name):
                Path(folder, each.name).symlink_to(each)
        entry: Entry = {"row": "node"}
        for word in ("made", "cached"):
            environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
            entry[word], entry[f"{word}_processor"] = _seconds_to_warm(subject, environment)
        yield entry


_PACKAGE = "placement_planner_ros"
_KERNELS = re.compile(r"-[0-9a-f]{16}$")
"""Ends the names of folders that kernels are kept in; what is made of meshes lies beside them."""


def _seconds_to_warm(
    subject: Subject, environment: dict[str, str]
) -> tuple[float | None, float | None]:
    paths = [str(folder) for folder in subject.package_dirs]
    command = [sys.executable, "-m", f"{_PACKAGE}.ros.node", "--ros-args"]
    command += ["--params-file", str(subject.file), "-p", f"package_paths:={json.dumps(paths)}"]
    began = time.monotonic()
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, env=environment
    )
    assert process.stderr is not None
    try:
        for line in process.stderr:
            if "]: warm:" in line:
                return time.monotonic() - began, _processor_time(process.pid)
            if time.monotonic() - began > _WARM:
                return None, None
        return None, None
    finally:
        process.terminate()
        with suppress(subprocess.TimeoutExpired):
            process.wait(10.0)
        process.kill()
        process.stderr.close()


def _processor_time(pid: int) -> float:
    """Seconds that a process has used, with those of its children that have ended."""
    stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
    after_name = stat.rpartition(")")[2].split()
    return sum(map(int, after_name[11:15])) / os.sysconf("SC_CLK_TCK")


def measure_agreement(subject: Subject, count: int) -> Iterator[Entry]:
    """The planner's answers about its arms by the original triangles."""
    rng = np.random.default_rng(0)
    files = RobotFiles(subject.urdf, subject.package_dirs)
    share = -(-count // len(subject.arms))
    for arm in subject.arms:
        obstacles = clutter(subject.robot, arm, subject.q_start, 20, rng)
        settings = CollisionSettings()
        found = compare(subject.robot, arm, subject.q_start, files, obstacles, share, rng, settings)
        put, missed = small_boxes_inside(subject.robot, arm, subject.q_start, files, rng)
        yield {
            "row": "agreement",
            "arm": arm.name,
            "configurations": found.configurations,
            "called_free": found.called_free,
            "wrongly_free": found.wrongly_free,
            "clear": found.clear,
            "clear_called_free": found.clear_called_free,
            "wrong": list(found.wrong),
            "inside": put,
            "inside_missed": missed,
        }


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure one robot; what `python -m benchmarks robots` starts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--beside", type=Path, required=True)
    parser.add_argument("--packages", type=Path, nargs="+", required=True)
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=ROWS)
    parser.add_argument("--configurations", type=int, required=True)
    given = parser.parse_args(arguments)
    subject = read_subject(given.file, given.packages)
    if "node" in given.rows:
        _tell(subject, measure_node(subject))
    beside = read_subject(given.beside, given.packages)
    for each in (beside, subject)[: 1 if given.file == given.beside else 2]:
        if each is beside:
            warm_up(each.robot, each.arms, each.q_start)
    rows = {
        "collision": measure_collision(subject),
        "edges": measure_edges(subject, beside),
        "first": measure_first(subject),
        "samples": measure_samples(subject),
        "agreement": measure_agreement(subject, given.configurations),
    }
    for row, entries in rows.items():
        if row in given.rows:
            _tell(subject, entries)
    return 0


def _tell(subject: Subject, entries: Iterator[Entry]) -> None:
    for entry in islice(entries, None):
        print(json.dumps({"robot": subject.name, **entry}), flush=True)


if __name__ == "__main__":
    sys.exit(main())
