"""Check every placement of `python -m benchmarks situations`, and release it in a physics engine.

python test/by_hand verify_situations results/situations

Writes `verdicts.jsonl` there, which the command's table counts.
"""

from __future__ import annotations

import argparse
import functools
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
from by_hand.settle_cases import FRICTIONS, MOVED, TILTED
from by_hand.verify_cases import measured_boxes, read_solution
from helpers.settle import settle_placed
from helpers.tasks import yumi_checker, yumi_task

from benchmarks.household import object_by_name
from benchmarks.json_lines import append_line, read_lines
from benchmarks.situations.catalogue import situation_by_name
from benchmarks.situations.observing import observe
from benchmarks.situations.report import VERDICTS_FILE
from benchmarks.situations.runs import OBJECTIVE, RUNS_FILE, SOLUTIONS, job_key
from placement_planner_ros.scenes.yumi import TIP_FRAMES, load_yumi, yumi_arm


def checker_of(situation, cloud):
    """The checker of a situation; the margin is checked on what was measured of all of it."""
    held, measured = object_by_name(situation.thing), None
    if cloud == "complete":
        points = observe(situation, cloud, np.random.default_rng(0)).points
        measured = measured_boxes(situation.scene, held, points)
    objective = OBJECTIVE if cloud == "complete" else ""
    changes = {"measured": measured, "support": situation.support}
    return yumi_checker(yumi_task(situation.scene, held, objective, **changes))


@functools.cache
def _robot():
    return load_yumi()


def verdict(folder, run, number):
    """What the checker says of a placement, and how far it comes when released."""
    situation = situation_by_name(run["name"], run["seed"])
    with np.load(folder / SOLUTIONS / f"{job_key(run)}-{number}.npz") as data:
        touch = {name: yumi_arm(_robot(), name).touch_links for name in TIP_FRAMES}
        solution = read_solution(data, situation.thing, touch)
    refused = checker_of(situation, run["cloud"]).check(solution)
    held, moved, tilted = object_by_name(situation.thing), 0.0, 0.0
    for friction in FRICTIONS:
        T, solids = pin.SE3(solution.placement_pose), situation.scene.parts
        result = settle_placed(solids, held, T, friction=friction)
        moved, tilted = max(moved, result.moved), max(tilted, result.tilted)
    return {
        "run": job_key(run),
        "number": number,
        "refused": refused,
        "stays": bool(moved < MOVED and tilted < TILTED),
        "moved": moved,
        "tilted": float(np.rad2deg(tilted)),
    }


def main() -> int:
    """1 where a placement is refused or does not stay."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    known = {(each["run"], each["number"]) for each in read_lines(folder / VERDICTS_FILE)}
    for run in read_lines(folder / RUNS_FILE):
        for number in range(1, len(run["solutions"]) + 1):
            if (job_key(run), number) in known:
                continue
            told = verdict(folder, run, number)
            append_line(folder / VERDICTS_FILE, told)
            if told["refused"] or not told["stays"]:
                print(told, flush=True)
    verdicts = read_lines(folder / VERDICTS_FILE)
    wrong = sum(bool(each["refused"]) or not each["stays"] for each in verdicts)
    print(f"{wrong} of {len(verdicts)} placements are refused or do not stay")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
