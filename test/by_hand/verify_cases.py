"""Check every recorded solution of `python -m benchmarks cases` and write the table of the runs.

python test/by_hand verify_cases results/cases --table complete.md
"""

from __future__ import annotations

import argparse
import functools
import json
import sys
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from checker import Solution, SolutionChecker
from helpers.tasks import yumi_checker, yumi_task

from benchmarks.cases import case_scene
from benchmarks.household import object_by_name
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.problem import workspace
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.objects import GraspedObject
from placement_planner_ros.scenes.scenes import Scene, scene_by_name
from placement_planner_ros.scenes.yumi import (
    GRIPPER_JOINTS,
    GRIPPER_OPEN,
    TIP_FRAMES,
    load_yumi,
    start_configuration,
    yumi_arm,
)


def case_checker(case: dict[str, str], contact: float = 0.003) -> SolutionChecker:
    """The checker of one case."""
    scene, held = case_scene(case["scene"]), object_by_name(case["object"])
    measured = _measured(case["scene"], case["object"]) if case["cloud"] == "complete" else None
    return yumi_checker(
        yumi_task(scene, held, case["objective"], measured=measured), contact=contact
    )


@functools.cache
def _measured(scene_name: str, object_name: str) -> np.ndarray:
    """Boxes around a complete cloud, which is the same in every run."""
    scene = scene_by_name(scene_name)
    return measured_boxes(scene, object_by_name(object_name), complete_cloud(scene))


def measured_boxes(scene: Scene, held: GraspedObject, points: np.ndarray) -> np.ndarray:
    """(2, n, 3) corners of the boxes around the points within reach."""
    robot = load_yumi()
    bounds = workspace(
        robot,
        tuple(yumi_arm(robot, name, grasps) for name, grasps in held.grasps.items()),
        robot.configuration(start_configuration(held)),
        Body.from_mesh(held.vertices, held.triangles, held.center_of_mass),
        scene.volume,
    )
    obstacles = ObstacleSet.from_points(points, GridSettings(), bounds)
    return np.stack([obstacles.lower, obstacles.upper])


NAMES = ("times", "positions", "velocities", "accelerations")


def load_solution(path: Path, touch_links: Mapping[str, tuple[str, ...]]) -> tuple[dict, Solution]:
    """The case a file belongs to, and the solution in it."""
    with np.load(path) as data:
        case = json.loads(str(data["case"]))
        return case, read_solution(data, case["object"], touch_links)


def read_solution(
    data: Mapping[str, np.ndarray], thing: str, touch_links: Mapping[str, tuple[str, ...]]
) -> Solution:
    """What was published of that object, as `save_placement` wrote it."""
    arm = str(data["arm"])
    joints = tuple(str(j) for j in data["joints"])
    trajectory = SimpleNamespace(joints=joints, **{n: data[n] for n in NAMES})
    retreat = None
    if "retreat_times" in data:
        retreat = SimpleNamespace(joints=joints, **{n: data[f"retreat_{n}"] for n in NAMES})
    return Solution(
        trajectory=trajectory,
        approach_start=float(data["approach_start"]),
        placement_pose=data["T_world_object"],
        objective=float(data["objective"]),
        tip_frame=TIP_FRAMES[arm],
        T_tip_object=object_by_name(thing).grasps[arm][int(data["grasp"])].homogeneous,
        touch_links=touch_links[arm],
        retreat=retreat,
        gripper_open={GRIPPER_JOINTS[arm]: GRIPPER_OPEN},
    )


def verify(folder: Path) -> tuple[list[dict], dict[str, list[str]]]:
    """Runs recorded in the folder, and the violations found by file name."""
    runs = [json.loads(line) for line in (folder / "runs.jsonl").read_text().splitlines()]
    robot = load_yumi()
    touch = {name: yumi_arm(robot, name).touch_links for name in TIP_FRAMES}
    checkers: dict[str, SolutionChecker] = {}
    violations: dict[str, list[str]] = {}
    for run in runs:
        case = run["case"]
        key = "-".join((case["scene"], case["object"], case["objective"], case["cloud"]))
        if key not in checkers:
            checkers = {key: case_checker(case)}
        previous = None
        run["refused"] = 0
        for number in range(1, len(run["solutions"]) + 1):
            path = folder / "solutions" / f"{key}-{run['seed']}-{number}.npz"
            _, solution = load_solution(path, touch)
            found = checkers[key].check(solution, previous)
            previous = solution.objective
            if found:
                violations[path.name] = found
                run["refused"] += 1
                print(f"{path.name}: {'; '.join(found)}", flush=True)
    return runs, violations


def table(runs: list[dict]) -> str:
    """Markdown: one row per case over its seeds."""
    rows = [
        "| scene | object | objective | runs | first solution, s: median, worst | third "
        "| solutions | refused | first objective, m | last objective, m |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    groups = defaultdict(list)
    for run in runs:
        groups[tuple(run["case"][k] for k in ("scene", "object", "objective"))].append(run)
    for (scene, name, objective), group in groups.items():
        times = [
            [r["solutions"][n]["time"] if len(r["solutions"]) > n else np.inf for r in group]
            for n in (0, 2)
        ]
        ends = [[r["solutions"][n]["objective"] for r in group if r["solutions"]] for n in (0, -1)]
        cells = (
            scene,
            name,
            objective.split("_")[0],
            str(len(group)),
            *map(_spread_of_times, times),
            str(sum(len(r["solutions"]) for r in group)),
            str(sum(r["refused"] for r in group)),
            *(f"{min(values):+.3f} … {max(values):+.3f}" if values else "none" for values in ends),
        )
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def _spread_of_times(times: list[float]) -> str:
    """Median and worst; runs without count as endless."""
    return ", ".join(
        f"{t:.2f}" if np.isfinite(t) else "never" for t in (np.median(times), max(times))
    )


def summary(runs: list[dict], refused: int) -> str:
    """How many runs were solved, how soon, and what the checker said."""
    solved = sum(bool(run["solutions"]) for run in runs)
    times = [r["solutions"][0]["time"] if r["solutions"] else np.inf for r in runs]
    solutions = sum(len(run["solutions"]) for run in runs)
    return (
        f"{solved} of {len(runs)} runs solved, the first solution after {_spread_of_times(times)} s"
        f" (median, worst). Of {solutions} solutions the checker refused {refused or 'none'}."
    )


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--table", type=Path)
    arguments = parser.parse_args()
    runs, violations = verify(arguments.folder)
    text = f"{summary(runs, len(violations))}\n\n{table(runs)}"
    print(text)
    if arguments.table:
        arguments.table.write_text(text, encoding="utf-8")
    return 1 if violations else 0


if __name__ == "__main__":
    sys.exit(main())
