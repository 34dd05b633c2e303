"""The rows of the table: what each is, its target, and how it comes from raw entries."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.machine import machine, versions
from benchmarks.speed.measures import median, percentile

Entry = dict[str, Any]

MADE_WITH = "made_with"
"""`row` of an entry that belongs to the rows it lists."""


def made_with(rows: Sequence[str]) -> Entry:
    """An entry that says what these rows were measured with, and on which day."""
    day = time.strftime("%Y-%m-%d")
    return {"row": MADE_WITH, "rows": list(rows), "day": day, **machine(), **versions()}


@dataclass(frozen=True, slots=True)
class Line:
    """One measured figure beside its target.

    Attributes:
        value: NaN where it could not be measured.
        shown: the value with its unit.
        wanted: the target with its unit, after >= where more is better.
        detail: over what it was measured, and what did not go well.
    """

    row: str
    what: str
    value: float
    target: float
    shown: str
    wanted: str
    detail: str

    @property
    def margin(self) -> float:
        """How many times better than the target; infinity where the target is a zero that holds."""
        if not math.isfinite(self.value):
            return 0.0
        if self.target == 0.0:
            return math.inf if self.value == 0.0 else 0.0
        if self.wanted.startswith(">="):
            return self.value / self.target
        return self.target / self.value if self.value > 0.0 else math.inf

    @property
    def met(self) -> bool:
        """Whether the target holds."""
        return self.margin >= 1.0


def _over_cases(
    row: str, what: str, values: Sequence[float], target: float, unit: str, detail: str
) -> Line:
    """Rates or ratios over cases: the median counts, what 95 % of the cases exceed is told."""
    digits = ",.0f" if unit == " /s" else ".1f"
    middle, low = f"{median(values):{digits}}{unit}", f"{percentile(values, 5):{digits}}"
    shown = f"{middle} (95 % of the cases above {low}{unit.strip(' /s')})"
    wanted = f">= {target:,.0f}{unit}"
    return Line(row, what, median(values), target, shown, wanted, detail)


def _latency(
    row: str, what: str, seconds: Sequence[float], limits: Mapping[int, float], detail: str
) -> list[Line]:
    """A line for each percentile that has a target, in milliseconds."""
    lines = []
    for share, target in limits.items():
        value = percentile(seconds, share)
        named = f"{what}, {'median' if share == 50 else f'{share:g} %'}"
        shown, wanted = f"{1e3 * value:,.0f} ms", f"<= {1e3 * target:,.0f} ms"
        lines.append(Line(row, named, value, target, shown, wanted, detail))
    return lines


def _total(entries: Sequence[Entry], key: str) -> float:
    return float(sum(entry[key] for entry in entries))


def _count(entries: Sequence[Entry], key: str) -> int:
    return int(_total(entries, key))


def _share(part: float, whole: float) -> str:
    return f"{part / whole:.1%}" if whole else "none"


def _each(entries: Sequence[Entry], key: str, count: float) -> str:
    return f"{1e6 * _total(entries, key) / count:.1f} µs" if count else "none measured"


def _by_scene(entries: Sequence[Entry]) -> dict[str, list[Entry]]:
    scenes: dict[str, list[Entry]] = {}
    for entry in entries:
        scenes.setdefault(entry["case"].split("/")[0], []).append(entry)
    return scenes


def _parts(entries: Sequence[Entry], *names: str) -> str:
    """Median milliseconds of each part."""
    return ", ".join(
        f"{name.replace('_', ' ')} {1e3 * median([e[f'{name}_seconds'] for e in entries]):.0f}"
        for name in names
    )


def _configurations(entries: Sequence[Entry]) -> list[Line]:
    asked, free = _total(entries, "queries"), _total(entries, "free")
    rates = [e["queries"] / e["seconds"] for e in entries]
    detail = (
        f"{asked:,.0f} recorded configurations of {len(entries)} cases, "
        f"{_share(free, asked)} free, "
        f"{_share(_total(entries, 'undecided'), asked)} left undecided; "
        f"{_each(entries, 'free_seconds', free)} for a free one, "
        f"{_each(entries, 'colliding_seconds', asked - free)} for a colliding one"
    )
    what = "configurations per second and core, fast tier"
    return [_over_cases("configurations", what, rates, 400_000.0, " /s", detail)]


def _answers(entries: Sequence[Entry]) -> list[Line]:
    asked = _total(entries, "queries")
    ratios = [e["exact_seconds"] / e["seconds"] for e in entries]
    detail = (
        f"{asked:,.0f} of the same, {_share(_total(entries, 'free'), asked)} free, "
        f"{_count(entries, 'disagreements')} answers differ; coal alone "
        f"{asked / _total(entries, 'exact_seconds'):,.0f} /s"
    )
    what = "the same answered to the end, against coal alone"
    return [_over_cases("answers", what, ratios, 20.0, "x", detail)]


def _agreement(entries: Sequence[Entry]) -> list[Line]:
    lines = []
    for scene, own in _by_scene(entries).items():
        wrong, asked = _total(own, "disagreements"), _total(own, "queries")
        detail = (
            f"{asked:,.0f} configurations, {_share(_total(own, 'free'), asked)} free, "
            f"{_count(own, 'ties')} ties, {_count(own, 'contradictions')} where coal contradicts "
            "itself or a ball lies in both of what it calls apart"
        )
        what = f"disagreements with the exact check, {scene}"
        lines.append(Line("agreement", what, wrong, 0.0, f"{wrong:.0f}", "0", detail))
    return lines


def _edges(entries: Sequence[Entry]) -> list[Line]:
    asked, certified = _total(entries, "queries"), _total(entries, "certified")
    missed = _total(entries, "sampled_free") - certified + _total(entries, "refuted")
    ratios = [e["exact_seconds"] / e["seconds"] for e in entries]
    detail = (
        f"{asked:,.0f} recorded edges, {_share(certified, asked)} certified free; coal refutes "
        f"{_count(entries, 'refuted')} of those, and finds {missed:.0f} free that are not certified"
    )
    what = "edges certified to the end, against coal every 5 mm"
    return [_over_cases("edges", what, ratios, 30.0, "x", detail)]


def _kinematics(entries: Sequence[Entry]) -> list[Line]:
    lines = []
    for name, found, seconds, over in (
        ("poses that 256 seeds solve", "solvable_found", "solvable_seconds", "exhaustive"),
        ("all recorded poses", "found", "seconds", "poses"),
    ):
        for scene, own in _by_scene(entries).items():
            spent = _total(own, seconds)
            rate = _total(own, found) / spent if spent else math.nan
            what = f"collision-free IK solutions per second, {name}, {scene}"
            detail = f"{_count(own, over)} poses, {_count(own, found)} solutions"
            lines.append(Line("ik", what, rate, 7000.0, f"{rate:,.0f} /s", ">= 7,000 /s", detail))
    solvable, missed = _total(entries, "exhaustive"), _total(entries, "missed")
    share = 1.0 - missed / solvable if solvable else math.nan
    what = "of the poses that 256 random seeds solve, solved"
    detail = f"{solvable:.0f} such poses of {_count(entries, 'poses')}; {missed:.0f} not solved"
    return [*lines, Line("ik", what, share, 0.99, f"{share:.1%}", ">= 99 %", detail)]


def _samples(entries: Sequence[Entry]) -> list[Line]:
    rates = [e["samples"] / e["seconds"] for e in entries]
    slowest = min(zip(rates, (e["case"] for e in entries), strict=True))
    detail = f"{_count(entries, 'samples'):,} samples; slowest {slowest[1]}: {slowest[0]:,.0f} /s"
    what = "goal samples tried per second in search"
    return [_over_cases("samples", what, rates, 10_000.0, " /s", detail)]


def _clouds(entries: Sequence[Entry]) -> list[Line]:
    lines = []
    for kind in dict.fromkeys(e["kind"] for e in entries):
        own = [e for e in entries if e["kind"] == kind]
        parts = _parts(own, "environment", "clearance", "collision_field")
        detail = f"{len(own)} times over {len({e['scene'] for e in own})} scenes; ms: {parts}"
        detail += f"; CPU {1e3 * median([e['cpu_seconds'] for e in own]):.0f}"
        what = f"{kind} cloud of {own[0]['points']:,} points to obstacle set, regions and fields"
        slowest = {50: 0.25, 95: 0.25}
        lines += _latency("clouds", what, [e["seconds"] for e in own], slowest, detail)
    return lines


def first_seconds(entry: Entry, *, environment: bool) -> float:
    """Seconds to the first placement; a run without one takes its limit at least."""
    seconds = float(entry["planner_seconds"] + entry["search_seconds"])
    if environment:
        seconds += entry["environment_seconds"]
    return seconds if entry["solved"] else max(seconds, float(entry["limit"]))


def _first(entries: Sequence[Entry]) -> list[Line]:
    lines = []
    unsolved = sum(not e["solved"] for e in entries)
    parts = _parts(entries, "environment", "planner", "search")
    cpu = 1e3 * median([e["cpu_seconds"] for e in entries])
    detail = f"{len(entries)} runs, {unsolved} unsolved; median ms: {parts}"
    detail += f"; CPU of planner and search {cpu:.0f}"
    for name, environment in (("environment ready", False), ("environment built from it", True)):
        seconds = [first_seconds(e, environment=environment) for e in entries]
        what = f"first placement from the start call, {name}"
        lines += _latency("first", what, seconds, {50: 0.25, 95: 1.0}, detail)
    return lines


def _checked(entries: Sequence[Entry]) -> list[Line]:
    refused, checked = _total(entries, "refused"), _total(entries, "checked")
    detail = f"{checked:.0f} first placements looked at by test/checker"
    what = "first placements that the independent checker refuses"
    value = refused if checked else math.nan
    return [Line("checked", what, value, 0.0, f"{refused:.0f}", "0", detail)]


def _plain(entries: Sequence[Entry]) -> list[Line]:
    """Entries of the plain path, beside those of the same runs by the planner."""
    stock = [e for e in entries if e["row"] == "plain"]
    unsolved = sum(not e["solved"] for e in stock)
    plain = [first_seconds(e, environment=False) for e in stock]
    runs = {(e["case"], e["seed"]) for e in stock}
    ours = (e for e in entries if e["row"] == "first" and (e["case"], e["seed"]) in runs)
    own = [first_seconds(e, environment=False) for e in ours]
    ratio = median(plain) / median(own) if own else math.nan
    detail = (
        f"{len(plain)} runs, {unsolved} unsolved at their limit; median {median(plain):.2f} s, "
        f"95 % {percentile(plain, 95):.2f} s, beside {median(own):.2f} s and "
        f"{percentile(own, 95):.2f} s of the same runs"
    )
    what = "first placement against uniform + RRTConnect + coal, medians"
    return [Line("plain", what, ratio, 10.0, f"{ratio:.1f}x", ">= 10x", detail)]


def _goal_sets(entries: Sequence[Entry]) -> list[Line]:
    seconds = [e["seconds"] for e in entries]
    unsolved = sum(not e["solved"] for e in entries)
    goals = median([e["goals"] for e in entries])
    detail = (
        f"{len(entries)} recorded queries, {unsolved} unsolved, {goals:g} goals in the median; "
        f"median CPU {1e3 * median([e['cpu_seconds'] for e in entries]):.0f} ms"
    )
    limits = {50: 0.02, 95: 0.2}
    lines = _latency("goal_sets", "planning to a goal set in a cabinet", seconds, limits, detail)
    both = [e for e in entries if "plain_seconds" in e]
    if both:
        ours, plain = ([e[key] for e in both] for key in ("seconds", "plain_seconds"))
        ratio = median(plain) / median(ours)
        unsolved = sum(not e["plain_solved"] for e in both)
        detail = (
            f"{len(both)} of the queries, medians {1e3 * median(plain):,.0f} and "
            f"{1e3 * median(ours):,.0f} ms; RRTConnect leaves {unsolved} unsolved at its limit"
        )
        what = "the same against RRTConnect with coal every 5 mm, medians"
        lines.append(Line("goal_sets", what, ratio, 10.0, f"{ratio:.1f}x", ">= 10x", detail))
    return lines


def _node(entries: Sequence[Entry]) -> list[Line]:
    lines = []
    for kind, what, limits in (
        ("start", "node: answer of ~/start", {50: 0.1, 95: 0.1}),
        ("service", "node: answers of other services during a search", {50: 0.02}),
        ("stop", "node: from the stop call to idle", {50: 0.1, 99: 0.1}),
        ("first", "node: from the start call to ~/solution", {50: 0.25, 95: 1.0}),
    ):
        own = [e for e in entries if e["kind"] == kind]
        seconds = [e["seconds"] for e in own]
        if own:
            unsolved = sum(not e.get("solved", True) for e in own)
            detail = f"{len(seconds)} calls, slowest {1e3 * max(seconds):,.0f} ms"
            detail += f"; {unsolved} without one at the limit" if unsolved else ""
            lines += _latency("node", what, seconds, limits, detail)
    return lines


def _load(entries: Sequence[Entry]) -> list[Line]:
    """The node beside three clouds of 300,000 points at 10 Hz."""
    lines = []
    for kind, what, limits in (
        ("start", "beside 3 clouds at 10 Hz: answer of ~/start", {50: 0.1, 99: 0.1}),
        ("stop", "beside 3 clouds at 10 Hz: from the stop call to idle", {50: 0.1, 99: 0.1}),
        ("age", "beside 3 clouds at 10 Hz: age of the newest one known", {100: 0.5}),
        ("alarm", "from a cloud in the way to best_valid: false", {50: 0.1, 95: 0.1, 99: 0.2}),
    ):
        seconds = [e["seconds"] for e in entries if e["kind"] == kind]
        if seconds:
            untold = sum(not e.get("told", True) for e in entries if e["kind"] == kind)
            detail = f"{len(seconds)} times, slowest {1e3 * max(seconds):,.0f} ms"
            detail += f"; {untold} never" if untold else ""
            lines += _latency("load", what, seconds, limits, detail)
    turns = [e for e in entries if e["kind"] == "samples"]
    if turns:
        without, beside = (_total(turns, key) / len(turns) for key in ("without", "beside"))
        fall = 100.0 * (1.0 - beside / without)
        what = "samples per second that 3 clouds at 10 Hz cost a search"
        detail = f"{without:,.0f} /s without them and {beside:,.0f} /s beside them, in turns"
        lines.append(Line("load", what, fall, 25.0, f"{fall:.0f} %", "<= 25 %", detail))
    return lines


def slope_per_hour(seconds: Sequence[float], values: Sequence[float]) -> float:
    """Of a straight line through the last four fifths of the points, in units per hour."""
    skipped = len(seconds) // 5
    if len(seconds) - skipped < 3:
        return math.nan
    return float(np.polyfit(seconds[skipped:], values[skipped:], 1)[0] * 3600.0)


def _memory(entries: Sequence[Entry]) -> list[Line]:
    lines = []
    for run in dict.fromkeys(e["run"] for e in entries):
        own = [e for e in entries if e["run"] == run]
        seconds, used = [e["time"] for e in own], [e["bytes"] / 1e6 for e in own]
        slope = slope_per_hour(seconds, used)
        detail = (
            f"{(seconds[-1] - seconds[0]) / 60:.1f} minutes of one search, {len(own)} readings; "
            f"{used[0]:.0f} MB at its start, {used[-1]:.0f} MB at its end, "
            f"slope {slope:+.0f} MB per hour after the first fifth"
        )
        what = "resident memory of the node in a search, most"
        most = max(used)
        lines.append(Line("memory", what, most, 700.0, f"{most:.0f} MB", "<= 700 MB", detail))
    return lines


_LINES: dict[str, Callable[[Sequence[Entry]], list[Line]]] = {
    "configurations": _configurations,
    "answers": _answers,
    "agreement": _agreement,
    "edges": _edges,
    "ik": _kinematics,
    "samples": _samples,
    "clouds": _clouds,
    "first": _first,
    "checked": _checked,
    "plain": _plain,
    "goal_sets": _goal_sets,
    "node": _node,
    "memory": _memory,
    "load": _load,
}
"""Row -> its lines, in the table's order."""

ROWS = tuple(row for row in _LINES if row not in ("checked", "memory"))
"""What can be chosen; `first` brings the checker's answers, `node` its memory."""


def lines_of(entries: Sequence[Entry]) -> list[Line]:
    """The table's lines, in its order; failed jobs count as a line that is not met."""
    lines: list[Line] = []
    for row, make in _LINES.items():
        asked = (row, "first") if row == "plain" else (row,)  # which is compared with it
        own = [e for e in entries if e["row"] in asked and "error" not in e]
        if any(e["row"] == row for e in own):
            lines += make(own)
        failed = [e["error"] for e in entries if e["row"] == row and "error" in e]
        if failed:
            what, why, number = (
                f"{row}: jobs that failed",
                "; ".join(dict.fromkeys(failed)),
                len(failed),
            )
            lines.append(Line(row, what, float(number), 0.0, str(number), "0", why))
    return lines
