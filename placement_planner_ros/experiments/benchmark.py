"""`placement_benchmark`: the paper's cases, its evaluation, motion planning, and all speeds."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from ompl import util as ou

from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.experiments.cases import OBJECTIVES, Case, all_cases
from placement_planner_ros.experiments.evaluation.command import add_evaluation_commands
from placement_planner_ros.experiments.motion.comparison import compare
from placement_planner_ros.experiments.motion.problems import panda_problems
from placement_planner_ros.experiments.record import Record, run_case
from placement_planner_ros.experiments.speed.command import add_speed_command
from placement_planner_ros.experiments.trial import warm_process
from placement_planner_ros.scenes.objects import OBJECT_NAMES
from placement_planner_ros.scenes.scenes import SCENE_NAMES


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="placement_benchmark", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    cases = commands.add_parser("cases", help="run the 24 cases and record every solution")
    cases.add_argument("--seeds", type=int, default=3, help="runs per case (default %(default)s)")
    cases.add_argument("--first-seed", type=int, default=0)
    cases.add_argument("--seconds", type=float, default=30.0, help="time limit of a run")
    cases.add_argument("--enough", type=int, help="end a run after so many solutions")
    cases.add_argument("--cloud", choices=("complete", "cameras"), default="complete")
    cases.add_argument("--scene", choices=SCENE_NAMES, action="append")
    cases.add_argument("--object", choices=OBJECT_NAMES, action="append")
    cases.add_argument("--objective", choices=OBJECTIVES, action="append")
    cases.add_argument("--sampler", choices=("mcts", "uniform"), default="mcts")
    cases.add_argument("--no-local-optimization", action="store_true")
    cases.add_argument("--output", type=Path, default=Path("results/cases"))
    motion = commands.add_parser(
        "motion", help="motion planning and shortening on MoveIt problems, beside OMPL's own"
    )
    motion.add_argument(
        "data", type=Path, help="folder with problems/*/scene*.yaml and robots/panda_description"
    )
    motion.add_argument("--seeds", type=int, default=3, help="per problem (default %(default)s)")
    motion.add_argument("--paths", type=int, default=20, help="paths to shorten in both ways")
    motion.add_argument("--limit", type=float, default=10.0, help="seconds a search may take")
    cases.set_defaults(command_function=run_cases)
    motion.set_defaults(command_function=run_motion)
    add_evaluation_commands(commands)
    add_speed_command(commands)
    return parser


def _wanted(case: Case, arguments: argparse.Namespace) -> bool:
    return (
        (not arguments.scene or case.scene in arguments.scene)
        and (not arguments.object or case.object in arguments.object)
        and (not arguments.objective or case.objective in arguments.objective)
    )


def describe(record: Record) -> str:
    """One line for the terminal."""
    head = f"{record.case!s:<66} seed {record.seed}"
    if not record.solutions:
        return f"{head}  FAILED: {record.failure.strip().splitlines()[-1]}"
    first, last = record.solutions[0], record.solutions[-1]
    return (
        f"{head}  first {first.time:5.2f} s  {len(record.solutions):2d} solutions  "
        f"objective {first.objective:+.4f} -> {last.objective:+.4f}  "
        f"{record.samples / (record.elapsed - record.preparation):6.0f} samples/s"
    )


def run_cases(arguments: argparse.Namespace) -> int:
    """Run the wanted cases one after the other; one JSON line each in `runs.jsonl`."""
    variant = arguments.sampler + ("" if arguments.no_local_optimization else "+lo")
    jobs = [
        (case, seed)
        for case in all_cases(arguments.cloud)
        if _wanted(case, arguments)
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    ]
    arguments.output.mkdir(parents=True, exist_ok=True)
    print("warming up", flush=True)
    warm_process()
    failed = 0
    started = time.monotonic()
    with (arguments.output / "runs.jsonl").open("a", encoding="utf-8") as lines:
        for done, (case, seed) in enumerate(jobs, start=1):
            record = run_case(
                case,
                variant,
                seed,
                arguments.seconds,
                arguments.output / "solutions",
                arguments.enough,
            )
            failed += not record.solutions
            lines.write(record.to_json() + "\n")
            lines.flush()
            left = (time.monotonic() - started) / done * (len(jobs) - done)
            print(f"[{done}/{len(jobs)}, {left / 60:.0f} min left] {describe(record)}", flush=True)
    print(f"{len(jobs) - failed} of {len(jobs)} runs solved; recorded in {arguments.output}")
    return 1 if failed else 0


def run_motion(arguments: argparse.Namespace) -> int:
    """Goal-set RRT against OMPL's RRTConnect, and shortcutting against its simplifier."""
    ou.setLogLevel(ou.LogLevel.LOG_WARN)
    problems = panda_problems(arguments.data)
    for note in dict.fromkeys(note for problem in problems for note in problem.notes):
        print(f"start states: {note}")
    solved = compare(
        problems,
        range(arguments.seeds),
        arguments.paths,
        arguments.limit,
        lambda line: print(line, flush=True),
    )
    return 0 if solved else 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parsed = _parser().parse_args(arguments)
    try:
        return int(parsed.command_function(parsed))
    except PlacementPlannerError as error:
        print(f"placement_benchmark: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
