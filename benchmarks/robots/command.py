"""`python -m benchmarks robots`: what the planner does for robots as their makers ship them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.jobs import say
from benchmarks.json_lines import append_line, lines_told_by, read_lines, replace_lines
from benchmarks.machine import machine, versions
from benchmarks.options import add_table_options
from benchmarks.page import between_marks, require_marks
from benchmarks.robots.measures import ROWS, Entry
from benchmarks.robots.subject import SHARE
from benchmarks.text_table import TextTable
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.share import share_path

RAW_FILE, TABLE_FILE = "raw.jsonl", "robots.md"
_BESIDE = "panda"
_MEASURES = "benchmarks.robots.measures"


def add_robots_command(commands: Any) -> None:
    """Add `robots`, which sets `command_function`.

    Args:
        commands: what `ArgumentParser.add_subparsers` returned.
    """
    robots = commands.add_parser("robots", help="robots as their makers ship them")
    robots.add_argument(
        "files", type=Path, nargs="*", help="parameter files; those of config/robots unless given"
    )
    robots.add_argument(
        "--packages",
        type=Path,
        nargs="+",
        default=[],
        help="folders that hold packages, besides pip's share and a file's package_paths",
    )
    robots.add_argument(
        "--beside", type=Path, help=f"file of the robot to compare edges with; {_BESIDE}.yaml"
    )
    robots.add_argument(
        "--configurations",
        type=int,
        default=10_000,
        help="of each robot put to the check of its triangles; 1000000 takes up to 40 minutes",
    )
    add_table_options(robots, "results/robots", ROWS)
    robots.set_defaults(command_function=run_robots)


def run_robots(arguments: argparse.Namespace) -> int:
    """Measure each robot in a process of its own, then write the table; 1 where one failed.

    Raises:
        ParameterError: there are no files, or the page has no marks.
    """
    page, raw = arguments.page, arguments.output / RAW_FILE
    if page is not None:
        require_marks(page)
    failed = [] if arguments.report_only else _measure_robots(arguments, raw)
    table = robots_table(read_lines(raw))
    arguments.output.mkdir(parents=True, exist_ok=True)
    (arguments.output / TABLE_FILE).write_text(table, encoding="utf-8")
    if page is not None:
        between_marks(page, table)
    say(table)
    return 1 if failed else 0


def _measure_robots(arguments: argparse.Namespace, raw: Path) -> list[str]:
    """The robots that failed; what the file held of these rows and robots is replaced."""
    files = arguments.files or sorted(share_path("config", "robots").glob("*.yaml"))
    beside = arguments.beside or share_path("config", "robots", f"{_BESIDE}.yaml")
    if not files:
        raise ParameterError("files", [], "there are none; name parameter files")
    names = {file.stem for file in files}
    replace_lines(
        raw,
        (e for e in read_lines(raw) if e["robot"] not in names or e["row"] not in arguments.rows),
    )
    options = ["--beside", beside, "--configurations", arguments.configurations]
    options += ["--rows", *arguments.rows, "--packages", *arguments.packages, SHARE]
    failed = []
    for file in files:
        say(f"{file.stem}: {', '.join(arguments.rows)}")
        try:
            for entry in lines_told_by("-m", _MEASURES, str(file), *map(str, options)):
                append_line(raw, entry)
        except RuntimeError as error:
            failed.append(file.stem)
            say(f"{file.stem}: FAILED: {error}")
    return failed


def robots_table(entries: Sequence[Entry]) -> str:
    """One row for each robot and figure, with its target, as Markdown."""
    rows = []
    for robot in dict.fromkeys(entry["robot"] for entry in entries):
        own = [entry for entry in entries if entry["robot"] == robot]
        for row, lines in _LINES.items():
            found = [entry for entry in own if entry["row"] == row]
            for what, shown, target, met in lines(found) if found else ():
                rows.append((robot, what, shown, target, "yes" if met else "**no**"))
    made = ", ".join(f"{key} {value}" for key, value in {**machine(), **versions()}.items())
    header = ("robot", "what", "measured", "target", "met")
    return TextTable(header, rows, f"Written with: {made}.").markdown()


RobotLine = tuple[str, str, str, bool]


def _first_lines(entries: Sequence[Entry]) -> Iterator[RobotLine]:
    seconds = [entry["seconds"] for entry in entries]
    median, most = float(np.median(seconds)), max(seconds)
    unsolved = sum(not entry["solutions"] for entry in entries)
    over = f"{len(entries)} runs, {unsolved} unsolved"
    yield "first placement, median", f"{median:.2f} s; {over}", "<= 1 s", median <= 1.0
    yield "first placement, slowest", f"{most:.2f} s", "<= 5 s", most <= 5.0 and not unsolved
    refused = [words for entry in entries for words in entry.get("refused", ())]
    words = f"{len(refused)} faults in {sum(entry['solutions'] for entry in entries)} solutions"
    yield "solutions that the checker refuses", words, "0", not refused
    for entry in entries:
        if "megabytes" in entry:
            size = entry["megabytes"]
            yield "memory after the tenth run", f"{size:.0f} MB", "<= 700 MB", size <= 700.0


def _edges_lines(entries: Sequence[Entry]) -> Iterator[RobotLine]:
    for entry in entries:
        for word in ("certified", "refused"):
            own, other = entry[f"own_{word}"], entry[f"other_{word}"]
            if own is None or other is None:
                continue
            shown = f"{1e3 * own:.3f} ms, {own / other:.1f} x {entry['beside']}"
            shown += f"; {entry[f'own_{word}_number']} edges"
            yield f"edge of 0.5 rad, {word}", shown, "<= 3 x", own <= 3.0 * other


def _node_lines(entries: Sequence[Entry]) -> Iterator[RobotLine]:
    for entry in entries:
        for word, most in (("cached", 5.0), ("made", 60.0)):
            seconds, used = entry[word], entry[f"{word}_processor"]
            shown = "never" if seconds is None else f"{used:.1f} s, {seconds:.1f} s by the clock"
            met = seconds is not None and used <= most
            yield f"node start to warm, covers {word}", shown, f"<= {most:g} s", met


def _agreement_lines(entries: Sequence[Entry]) -> Iterator[RobotLine]:
    total = {
        key: sum(entry[key] for entry in entries)
        for key in ("configurations", "called_free", "wrongly_free", "clear", "clear_called_free")
    }
    shown = f"{total['wrongly_free']} of {total['called_free']:,} called free, of "
    shown += f"{total['configurations']:,} configurations"
    yield "nearer than the margin, called free", shown, "0", not total["wrongly_free"]
    share = total["clear_called_free"] / max(total["clear"], 1)
    shown = f"{100.0 * share:.3f} % of {total['clear']:,}"
    yield "farther than margin and 2 mm, called free", shown, ">= 99.9 %", share >= 0.999


_LINES: dict[str, Callable[[Sequence[Entry]], Iterator[RobotLine]]] = {
    "first": _first_lines,
    "edges": _edges_lines,
    "node": _node_lines,
    "agreement": _agreement_lines,
}
