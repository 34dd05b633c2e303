"""Run the requests of docs/wishes.md and have every solution checked.

python test/by_hand verify_wishes --seeds 3 --seconds 3
"""

from __future__ import annotations

import argparse
import functools
import sys
import time
from dataclasses import asdict, replace

import numpy as np
from by_hand.verify_cases import case_checker
from checker import Solution, SolutionChecker, check_asked, check_stance
from helpers.wishes import Request, requests

from benchmarks.cases import Case
from placement_planner_ros.core.errors import PlacementPlannerError


def run(request: Request, seed: int, seconds: float, whole: bool) -> tuple[int, float, list[str]]:
    """How many solutions, when the first came, and what the checker finds wrong.

    Args:
        seconds: of processor time, five times as many where nothing is found.
        whole: have the motion of the last one checked, too.
    """
    planner = request.planner(seed)
    begin = time.process_time()
    placements, first = [], np.inf

    def should_stop() -> bool:
        spent = time.process_time() - begin
        return spent >= (seconds if placements else 5.0 * seconds)

    for placement in planner.run(should_stop):
        first = min(first, time.process_time() - begin)
        placements.append(placement)
    judge = judge_of(request.scene, request.thing)
    boxes = np.array(request.values.get("keep_out", [])).reshape(-1, 2, 3)
    kind = request.values.get("objective", "maximize_clearance")
    task = replace(judge.task, asked=request.asked, keep_out=boxes, objective=kind)
    checker = SolutionChecker(task, judge.tolerances)
    found = []
    for placement in placements:
        T = placement.T_world_object.homogeneous
        found += check_asked(
            task, T, placement.objective, checker.clearance_bounds, checker.tolerances
        )
        found += check_stance(task, T, checker.tolerances)
    if placements and (whole or len(boxes)):
        arms = {h.arm.name: h.arm for h in planner.holdings.values()}
        last = placements[-1]
        found += checker.check(Solution.of(last, arms[last.arm]))
    return len(placements), first, found


@functools.cache
def judge_of(scene: str, thing: str) -> SolutionChecker:
    """What checks solutions for that thing in that scene."""
    return case_checker(asdict(Case(scene, thing, "maximize_clearance")))


def why_not(request: Request, seconds: float) -> str:
    """The code and words of one that cannot be had."""
    try:
        planner = request.planner(0)
    except PlacementPlannerError as error:
        return f"{error.code}: {error}"
    end = time.process_time() + seconds
    if list(planner.run(lambda: time.process_time() >= end)):
        return "solved"
    return f"{planner.cause or 'NO_SOLUTION'}: {planner.explain().cause}"


def main() -> int:
    """Print a line for each request; 1 where anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--whole", action="store_true", help="check the last one's motion, too")
    given = parser.parse_args()
    wrong = 0
    for number, request in enumerate(requests(), 1):
        if request.drop:
            told = why_not(request, given.seconds)
            freed, _, _ = run(request.freed, 0, given.seconds, False)
            fine = request.drop in told and freed > 0
            print(f"{number:3} {request.words} {told[:160]} | without {request.drop}: {freed}")
            wrong += not fine
            continue
        runs = [run(request, seed, given.seconds, given.whole) for seed in range(given.seeds)]
        faults = [fault for _, _, faults in runs for fault in faults]
        counts, firsts = [n for n, _, _ in runs], [round(first, 2) for _, first, _ in runs]
        print(f"{number:3} {request.words} solutions {counts}, first after {firsts} s {faults[:3]}")
        wrong += bool(faults) or 0 in counts
        sys.stdout.flush()
    print(f"{wrong} wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
