"""What is measured of one robot, in a process of its own, told as JSON lines."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.cases import CaseInputs, build_problem
from benchmarks.json_lines import ROOT
from benchmarks.machine import resident_megabytes
from benchmarks.record import RecordedRun
from benchmarks.robots.agreement import (
    RobotFiles,
    clutter_around,
    compare_answers,
    drawn_configurations,
)
from benchmarks.robots.subject import MeasuredRobot, read_measured_robot
from benchmarks.robots.things import (
    CLOUDS,
    OBJECTS,
    boxes_at_start,
    object_of,
    observe,
    outside_boxes,
    table_of,
)
from benchmarks.situations.observing import Observation
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.objective.objective import Objective
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.scene.flying_pixels import flying_pixels
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.types import Array, Placement
from placement_planner_ros.core.warmup.warm_up import warm_up
from placement_planner_ros.heaps import shrink_heaps

Entry = dict[str, Any]
ROWS = ("first", "edges", "node", "agreement")
_TESTS = ROOT / "test"
_SEEDS = 3
_LIMIT = 10.0
"""s of processor time for a first placement."""
_MORE = 1.0
"""s of processor time that a run goes on after it."""
_EDGES, _EDGE, _BESIDE = 400, 0.5, 0.030
"""Edges, their length in rad, and how near to contact half of them begin, m."""
_DRAWN = 20_000
"""Configurations from which the free ones are taken."""
_RUNS = 10
_WARM = 300.0


def problem_of(subject: MeasuredRobot, name: str, seen: Observation) -> tuple[Problem, Objective]:
    """The problem with one of `OBJECTS`, and the node's default objective in it.

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
    return build_problem(
        CaseInputs(robot, arms, q, body, volume, points),
        "maximize_clearance",
        lambda made: made.with_unknown(True, partial(outside_boxes, boxes_at_start(subject))),
        sights=sights,
    )


def measure_first(subject: MeasuredRobot) -> Iterator[Entry]:
    """First placements, in processor time from the cloud on, and what the checker says of all."""
    kinds = itertools.product(OBJECTS, CLOUDS, range(_SEEDS))
    for number, (name, cloud, seed) in enumerate(kinds, start=1):
        rng = np.random.default_rng(seed)
        around = boxes_at_start(subject)
        scene = table_of(subject.volume, np.random.default_rng(seed), around)
        seen = observe(scene, cloud, rng)
        entry: Entry = {"row": "first", "object": name, "cloud": cloud, "seed": seed}
        found: list[Placement] = []
        run, started = RecordedRun(seed, _LIMIT), time.process_time()
        try:
            problem, objective = problem_of(subject, name, seen)
            planner = PlacementPlanner(problem, objective, PlannerSettings(), rng)
            for placement in run.follow(planner, started):
                if not found:
                    run.time_limit = run.elapsed + _MORE
                found.append(placement)
            entry["refused"] = _checker_refusals(subject, scene, name, problem, found)
        except PlacementPlannerError as error:
            run.failure = f"{error.code}: {error}"
        seconds = run.solutions[0].time if found else _LIMIT
        entry |= {"seconds": seconds, "solutions": len(found), "failure": run.failure}
        shrink_heaps()  # as the node does once a run has ended
        if number == _RUNS:
            entry["megabytes"] = resident_megabytes(os.getpid())
        yield entry


def _checker_refusals(
    subject: MeasuredRobot, scene: Any, name: str, problem: Problem, found: Sequence[Placement]
) -> list[str]:
    """What the checker says."""
    if str(_TESTS) not in sys.path:
        sys.path.append(str(_TESTS))
    checker: Any = importlib.import_module("checker")
    pairs = "".join(
        f'<disable_collisions link1="{a}" link2="{b}"/>' for a, b in subject.robot.allowed_pairs
    )
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
        *object_of(subject, name),
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
    subject: MeasuredRobot, rng: np.random.Generator
) -> tuple[ArmCollision, list[tuple[Array, Array]]]:
    """An arm with the object in hand among clutter, and free starts of edges with their ends."""
    arm = subject.arms[0]
    moving = MovingArm(subject.robot, arm, subject.q_start)
    obstacles = clutter_around(moving, 20, rng)
    body = Body.from_mesh(subject.vertices, subject.triangles)
    collision = ArmCollision(moving, AttachedObject(body, 0), obstacles)
    drawn = drawn_configurations(collision, arm, _DRAWN, _BESIDE, rng)
    starts = np.vstack([Q[collision.free_batch(Q)][: _EDGES // 2] for Q in drawn])
    ways = rng.normal(size=starts.shape)
    ways *= _EDGE / np.linalg.norm(ways, axis=1, keepdims=True)
    return collision, list(zip(starts, np.clip(starts + ways, arm.lower, arm.upper), strict=True))


def measure_edges(subject: MeasuredRobot, beside: MeasuredRobot) -> Iterator[Entry]:
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


def measure_node(subject: MeasuredRobot) -> Iterator[Entry]:
    """Seconds from the start of the node's process to `warm`, without and with covers on disk.

    By the clock, and of processor time, which other work on the machine changes little.
    """
    if importlib.util.find_spec("rclpy") is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        entry: Entry = {"row": "node"}
        for word in ("made", "cached"):
            environment = {**os.environ, "XDG_CACHE_HOME": folder}
            entry[word], entry[f"{word}_processor"] = _seconds_to_warm(subject, environment)
        yield entry


def _seconds_to_warm(
    subject: MeasuredRobot, environment: dict[str, str]
) -> tuple[float | None, float | None]:
    paths = [str(folder) for folder in subject.package_dirs]
    command = [sys.executable, "-m", "placement_planner_ros", "placement_planner", "--ros-args"]
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


def _processor_time(process: int) -> float:
    """Seconds that a process has used, with those of its children that have ended."""
    return float(sum(psutil.Process(process).cpu_times()[:4]))


def measure_agreement(subject: MeasuredRobot, count: int) -> Iterator[Entry]:
    """The planner's answers about its arms by the original triangles."""
    rng = np.random.default_rng(0)
    files = RobotFiles(subject.urdf, subject.package_dirs)
    share = -(-count // len(subject.arms))
    for arm in subject.arms:
        moving = MovingArm(subject.robot, arm, subject.q_start)
        obstacles = clutter_around(moving, 20, rng)
        found = compare_answers(moving, files, obstacles, share, rng)
        yield {"row": "agreement", "arm": arm.name, **asdict(found)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure one robot; what `python -m benchmarks robots` starts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--beside", type=Path, required=True)
    parser.add_argument("--packages", type=Path, nargs="+", required=True)
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=ROWS)
    parser.add_argument("--configurations", type=int, required=True)
    given = parser.parse_args(arguments)
    subject = read_measured_robot(given.file, given.packages)
    if "node" in given.rows:
        _tell_entries(subject, measure_node(subject))
    beside = read_measured_robot(given.beside, given.packages)
    for each in (beside, subject):  # as before `warm`: what `first` needs is made
        warm_up(each.robot, each.arms, each.q_start)
    rows = {
        "edges": measure_edges(subject, beside),
        "first": measure_first(subject),
        "agreement": measure_agreement(subject, given.configurations),
    }
    for row, entries in rows.items():
        if row in given.rows:
            _tell_entries(subject, entries)
    return 0


def _tell_entries(subject: MeasuredRobot, entries: Iterator[Entry]) -> None:
    for entry in entries:
        print(json.dumps({"robot": subject.name, **entry}), flush=True)


if __name__ == "__main__":
    sys.exit(main())
