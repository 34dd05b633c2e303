"""`python -m benchmarks worlds`: is every published motion right in the true world?"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.household import object_by_name
from benchmarks.jobs import Entry, run_jobs, say
from benchmarks.json_lines import ROOT, read_lines
from benchmarks.machine import versions
from benchmarks.options import add_job_options
from benchmarks.text_table import TextTable
from benchmarks.worlds.kinds import KINDS
from benchmarks.worlds.world import World, seen_parts, start_of, yumi_srdf
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.types import Placement
from placement_planner_ros.ros.run.preparation import make_planner
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.start_checks import start_notes
from placement_planner_ros.ros.run.surroundings import Surroundings
from placement_planner_ros.share import PACKAGE, share_path

RUNS_FILE = "runs.jsonl"
FAULTS = {
    "cuts": ("collision", "release", "retreat"),
    "beyond limits": ("limits", "trajectory", "start", "end"),
    "off the surface": ("stance", "volume"),
}
"""What each kind of fault is by the first word of the checker's sentences."""
_ORDINARY_M = 0.006
"""That the contact may be off in clouds of cameras: an ordinary calibration and noise."""


@dataclass(frozen=True, slots=True)
class WorldJob:
    """One world, searched for so many seconds of processor time."""

    kind: str
    seed: int
    seconds: float
    enough: int

    @property
    def work(self) -> float:
        """Seconds at most."""
        return self.seconds

    @property
    def key(self) -> str:
        """Tells jobs apart."""
        return f"{self.kind} {self.seed} {self.seconds:g} {self.enough}"


def add_worlds_command(commands: Any) -> None:
    """Add `worlds`, which sets `command_function`.

    Args:
        commands: what `ArgumentParser.add_subparsers` returned.
    """
    worlds = commands.add_parser(
        "worlds", help="worlds as descriptions and cameras tell them; motions judged by the truth"
    )
    worlds.add_argument("--kind", choices=tuple(KINDS), action="append")
    worlds.add_argument("--seeds", type=int, default=10, help="of each kind")
    worlds.add_argument("--first-seed", type=int, default=0)
    worlds.add_argument("--seconds", type=float, default=3.0, help="processor time of a search")
    worlds.add_argument("--enough", type=int, default=3, help="motions after which a search ends")
    add_job_options(worlds, "results/worlds")
    worlds.set_defaults(command_function=_run_worlds)


def _run_worlds(arguments: argparse.Namespace) -> int:
    """1 where a motion is wrong."""
    path, limits = arguments.output / RUNS_FILE, (arguments.seconds, arguments.enough)
    jobs = [
        WorldJob(kind, seed, *limits)
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds)
        for kind in arguments.kind or KINDS
    ]
    run_jobs(run_world, jobs, path, describe_world, arguments.processes)
    entries = read_lines(path)
    say(worlds_table(entries))
    return int(any(motion["faults"] for entry in entries for motion in entry["motions"]))


def run_world(job: WorldJob) -> Entry:
    """Search a world, and judge what was found; where nothing was, whether there is something."""
    world = KINDS[job.kind](_generator(job))
    entry: Entry = {"kind": job.kind, "seed": job.seed, "name": world.name, "thing": world.thing}
    found, entry["refused"], entry["notes"] = _searched(world.snapshot(job.seed), job)
    judge = _judge_of(world)
    entry["motions"] = [
        {"objective": each.objective, "faults": judge(snapshot, each)} for snapshot, each in found
    ]
    entry["must_place"], entry["possible"] = world.must_place, bool(found)
    if not found and world.must_place:
        entry["possible"] = any(not judge(*each) for each in _searched_in_truth(world, job))
    return entry | {"commit": versions()["commit"]}


Found = list[tuple[Snapshot, Placement]]


def _generator(job: WorldJob) -> np.random.Generator:
    return np.random.default_rng([job.seed, *job.kind.encode()])


def _searched(snapshot: Snapshot, job: WorldJob) -> tuple[Found, str, list[str]]:
    """What a node would have published; or why it refuses to start; and what it says besides."""
    try:
        environment = Surroundings.of(snapshot).environment()
        notes = start_notes(snapshot, environment)
        planner = make_planner(snapshot, environment)
    except PlacementPlannerError as error:
        return [], f"{error.code}: {error}", []
    end, found = time.process_time() + job.seconds, Found()
    for placement in planner.run(lambda: time.process_time() > end):
        found.append((snapshot, placement))
        if len(found) >= job.enough:
            break
    told = [note for note in notes if note.startswith("clouds disagree")]
    return found, "" if found else str(planner.cause or ""), told


def _searched_in_truth(world: World, job: WorldJob) -> Found:
    """In a cloud of all surfaces, by the description of the checker."""
    parts = seen_parts(world.scene, [], _generator(job))
    plain = replace(world, parts=parts, urdf=world.true_urdf, joint_limits="")
    return _searched(plain.snapshot(job.seed), job)[0]


def _judge_of(world: World) -> Any:
    """What has the independent checker look at a placement."""
    if str(ROOT / "test") not in sys.path:
        sys.path.append(str(ROOT / "test"))
    from checker import Solution, SolutionChecker, Task, Tolerances

    held = object_by_name(world.thing)
    boxes = world.scene.volume.boxes
    of_camera = world.parts[0].origin is not None
    tolerances = Tolerances(contact=_ORDINARY_M) if of_camera else Tolerances()
    folder = share_path("urdf", "yumi.urdf").parent.parent
    task = Task(
        world.scene.parts, boxes[:, 0], boxes[:, 1], held.vertices, held.triangles,
        held.center_of_mass, world.true_urdf, yumi_srdf(), {PACKAGE: folder},
        start_of(world.thing, world.arm), "",
    )  # fmt: skip
    if world.accelerations:
        tolerances = replace(tolerances, acceleration_limit=world.accelerations)
    checker = SolutionChecker(task, tolerances)

    def judge(snapshot: Snapshot, placement: Placement) -> list[str]:
        return list(checker.check(Solution.of(placement, snapshot.arm(placement.goal.arm))))

    return judge


def describe_world(entry: Mapping[str, Any]) -> str:
    """One run in a line."""
    wrong = [fault for motion in entry["motions"] for fault in motion["faults"]]
    words = f"{entry['name']} {entry['seed']}: {len(entry['motions'])} motions"
    if not entry["motions"]:
        impossible = entry["must_place"] and not entry["possible"]
        words += f" ({entry['refused'][:100]}{'; impossible' if impossible else ''})"
    return f"{words}{'; WRONG: ' + '; '.join(wrong) if wrong else ''}"


def worlds_table(entries: Sequence[Mapping[str, Any]]) -> str:
    """How many motions of each kind are wrong, and how many worlds were placed in."""
    rows = []
    for name in sorted({entry["name"] for entry in entries}):
        own = [entry for entry in entries if entry["name"] == name]
        faults = [_fault_kinds(motion["faults"]) for e in own for motion in e["motions"]]
        counted = Counter(kind for kinds in faults for kind in kinds)
        wanted = [entry for entry in own if entry["must_place"] and entry["possible"]]
        placed = sum(bool(entry["motions"]) for entry in wanted)
        share = f"{placed} of {len(wanted)}" if wanted else "none wanted"
        told = sum(bool(entry["notes"]) for entry in own)
        cells = (str(counted[kind]) for kind in (*FAULTS, "other"))
        rows.append((name, str(len(own)), str(len(faults)), *cells, share, str(told)))
    header = ("world", "runs", "motions", *FAULTS, "other", "placed", "clouds disagree")
    return TextTable(header, rows).markdown()


def _fault_kinds(faults: Iterable[str]) -> set[str]:
    found = set()
    for fault in faults:
        word = fault.split(":")[0]
        found.add(next((kind for kind, words in FAULTS.items() if word in words), "other"))
    return found
