"""The rows of the table: what each is, its target, and how it comes from raw entries."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from placement_planner_ros.experiments.speed.measures import median, percentile

Entry = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Line:
    """One measured figure beside its target.

    Attributes:
        value: NaN where it could not be measured.
        higher: whether more is better.
        shown: the value with its unit.
        wanted: the target with its unit.
        detail: over what it was measured, and what did not go well.
    """

    row: str
    what: str
    value: float
    target: float
    higher: bool
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
        if self.higher:
            return self.value / self.target
        return self.target / self.value if self.value > 0.0 else math.inf

    @property
    def met(self) -> bool:
        """Whether the target holds."""
        return self.margin >= 1.0


def _rate(row: str, what: str, rates: Sequence[float], target: float, detail: str) -> Line:
    """A rate over cases: the median counts, the rate that 95 % of the cases exceed is told."""
    slow = percentile(rates, 5)
    return Line(
        row,
        what,
        median(rates),
        target,
        True,
        f"{median(rates):,.0f} /s (95 % of the cases above {slow:,.0f})",
        f">= {target:,.0f} /s",
        detail,
    )


def _times(row: str, what: str, ratios: Sequence[float], target: float, detail: str) -> Line:
    """A ratio over cases."""
    low = percentile(ratios, 5)
    return Line(
        row,
        what,
        median(ratios),
        target,
        True,
        f"{median(ratios):.1f}x (95 % of the cases above {low:.1f}x)",
        f">= {target:g}x",
        detail,
    )


def _latency(
    row: str, what: str, seconds: Sequence[float], limits: Mapping[int, float], detail: str
) -> list[Line]:
    """A line for each percentile that has a target, in milliseconds."""
    lines = []
    for share, target in limits.items():
        value = percentile(seconds, share)
        name = "median" if share == 50 else f"{share:g} %"
        lines.append(
            Line(
                row,
                f"{what}, {name}",
                value,
                target,
                False,
                f"{1e3 * value:,.0f} ms",
                f"<= {1e3 * target:,.0f} ms",
                detail,
            )
        )
    return lines


def _total(entries: Sequence[Entry], key: str) -> float:
    return float(sum(entry[key] for entry in entries))


def _count(entries: Sequence[Entry], key: str) -> int:
    return int(_total(entries, key))


def _share(part: float, whole: float) -> str:
    return f"{part / whole:.1%}" if whole else "none"


def _each(entries: Sequence[Entry], key: str, count: float) -> str:
    return f"{1e6 * _total(entries, key) / count:.1f} µs" if count else "none measured"


def _configurations(entries: Sequence[Entry]) -> list[Line]:
    asked, free = _total(entries, "queries"), _total(entries, "free")
    detail = (
        f"{asked:,.0f} recorded configurations of {len(entries)} cases, "
        f"{_share(free, asked)} free, "
        f"{_share(_total(entries, 'undecided'), asked)} left undecided; "
        f"{_each(entries, 'free_seconds', free)} for a free one, "
        f"{_each(entries, 'colliding_seconds', asked - free)} for a colliding one"
    )
    return [
        _rate(
            "configurations",
            "configurations per second and core, fast tier",
            [e["queries"] / e["seconds"] for e in entries],
            400_000.0,
            detail,
        )
    ]


def _answers(entries: Sequence[Entry]) -> list[Line]:
    asked = _total(entries, "queries")
    detail = (
        f"{asked:,.0f} of the same, {_share(_total(entries, 'free'), asked)} free, "
        f"{_count(entries, 'disagreements')} answers differ; coal alone "
        f"{asked / _total(entries, 'exact_seconds'):,.0f} /s"
    )
    return [
        _times(
            "answers",
            "the same answered to the end, against coal alone",
            [e["exact_seconds"] / e["seconds"] for e in entries],
            20.0,
            detail,
        )
    ]


def _agreement(entries: Sequence[Entry]) -> list[Line]:
    lines = []
    for scene in dict.fromkeys(e["case"].split("/")[0] for e in entries):
        own = [e for e in entries if e["case"].startswith(f"{scene}/")]
        wrong, asked = _total(own, "disagreements"), _total(own, "queries")
        detail = (
            f"{asked:,.0f} configurations, {_share(_total(own, 'free'), asked)} free, "
            f"{_count(own, 'ties')} ties, {_count(own, 'contradictions')} where coal contradicts "
            "itself or a ball lies in both of what it calls apart"
        )
        lines.append(
            Line(
                "agreement",
                f"disagreements with the exact check, {scene}",
                wrong,
                0.0,
                False,
                f"{wrong:.0f}",
                "0",
                detail,
            )
        )
    return lines


def _edges(entries: Sequence[Entry]) -> list[Line]:
    asked, certified = _total(entries, "queries"), _total(entries, "certified")
    missed = _total(entries, "sampled_free") - certified + _total(entries, "refuted")
    detail = (
        f"{asked:,.0f} recorded edges, {_share(certified, asked)} certified free; coal refutes "
        f"{_count(entries, 'refuted')} of those, and finds {missed:.0f} free that are not certified"
    )
    return [
        _times(
            "edges",
            "edges certified to the end, against coal every 5 mm",
            [e["exact_seconds"] / e["seconds"] for e in entries],
            30.0,
            detail,
        )
    ]


def _kinematics(entries: Sequence[Entry]) -> list[Line]:
    lines = []
    for name, found, seconds, over in (
        ("poses that 256 seeds solve", "solvable_found", "solvable_seconds", "exhaustive"),
        ("all recorded poses", "found", "seconds", "poses"),
    ):
        for scene in dict.fromkeys(e["case"].split("/")[0] for e in entries):
            own = [e for e in entries if e["case"].startswith(f"{scene}/")]
            spent = _total(own, seconds)
            rate = _total(own, found) / spent if spent else math.nan
            lines.append(
                Line(
                    "ik",
                    f"collision-free IK solutions per second, {name}, {scene}",
                    rate,
                    7000.0,
                    True,
                    f"{rate:,.0f} /s",
                    ">= 7,000 /s",
                    f"{_count(own, over)} poses, {_count(own, found)} solutions",
                )
            )
    solvable, missed = _total(entries, "exhaustive"), _total(entries, "missed")
    share = 1.0 - missed / solvable if solvable else math.nan
    lines.append(
        Line(
            "ik",
            "of the poses that 256 random seeds solve, solved",
            share,
            0.99,
            True,
            f"{share:.1%}",
            ">= 99 %",
            f"{solvable:.0f} such poses of {_count(entries, 'poses')}; {missed:.0f} not solved",
        )
    )
    return lines


def _samples(entries: Sequence[Entry]) -> list[Line]:
    rates = [e["samples"] / e["seconds"] for e in entries]
    slowest = min(zip(rates, (e["case"] for e in entries), strict=True))
    detail = f"{_count(entries, 'samples'):,} samples; slowest {slowest[1]}: {slowest[0]:,.0f} /s"
    return [
        _rate("samples", "goal samples tried per second in search", rates, 10_000.0, detail),
    ]


def _clouds(entries: Sequence[Entry]) -> list[Line]:
    lines = []
    for kind in dict.fromkeys(e["kind"] for e in entries):
        own = [e for e in entries if e["kind"] == kind]
        parts = ", ".join(
            f"{name.replace('_', ' ')} {1e3 * median([e[f'{name}_seconds'] for e in own]):.0f}"
            for name in ("environment", "clearance", "collision_field")
        )
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
    parts = ", ".join(
        f"{name} {1e3 * median([e[f'{name}_seconds'] for e in entries]):.0f}"
        for name in ("environment", "planner", "search")
    )
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
    detail = f"{checked:.0f} first placements looked at by test/checker.py"
    what = "first placements that the independent checker refuses"
    value = refused if checked else math.nan
    return [Line("checked", what, value, 0.0, False, f"{refused:.0f}", "0", detail)]


def _plain(entries: Sequence[Entry], ours: Sequence[Entry]) -> list[Line]:
    unsolved = sum(not e["solved"] for e in entries)
    plain = [first_seconds(e, environment=False) for e in entries]
    runs = {(e["case"], e["seed"]) for e in entries}
    own = [first_seconds(e, environment=False) for e in ours if (e["case"], e["seed"]) in runs]
    ratio = median(plain) / median(own) if own else math.nan
    detail = (
        f"{len(plain)} runs, {unsolved} unsolved at their limit; median {median(plain):.2f} s, "
        f"95 % {percentile(plain, 95):.2f} s, beside {median(own):.2f} s and "
        f"{percentile(own, 95):.2f} s of the same runs"
    )
    what = "first placement against uniform + RRTConnect + coal, medians"
    return [Line("plain", what, ratio, 10.0, True, f"{ratio:.1f}x", ">= 10x", detail)]


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
        lines.append(Line("goal_sets", what, ratio, 10.0, True, f"{ratio:.1f}x", ">= 10x", detail))
    return lines


def _node(entries: Sequence[Entry]) -> list[Line]:
    def of(kind: str) -> list[float]:
        return [e["seconds"] for e in entries if e["kind"] == kind]

    lines = []
    for kind, what, limits in (
        ("start", "node: answer of ~/start", {50: 0.1, 95: 0.1}),
        ("service", "node: answers of other services during a search", {50: 0.02}),
        ("stop", "node: from the stop call to idle", {50: 0.1, 99: 0.1}),
        ("first", "node: from the start call to ~/solution", {50: 0.25, 95: 1.0}),
    ):
        seconds = of(kind)
        if seconds:
            unsolved = sum(not e.get("solved", True) for e in entries if e["kind"] == kind)
            detail = f"{len(seconds)} calls, slowest {1e3 * max(seconds):,.0f} ms"
            detail += f"; {unsolved} without one at the limit" if unsolved else ""
            lines += _latency("node", what, seconds, limits, detail)
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
        lines.append(
            Line("memory", what, most, 700.0, False, f"{most:.0f} MB", "<= 700 MB", detail)
        )
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
    "goal_sets": _goal_sets,
    "node": _node,
    "memory": _memory,
}

ROWS = (
    "configurations",
    "answers",
    "agreement",
    "edges",
    "ik",
    "samples",
    "clouds",
    "first",
    "plain",
    "goal_sets",
    "node",
)
"""What can be chosen; `first` brings the checker's answers, `node` its memory."""


def lines_of(entries: Sequence[Entry]) -> list[Line]:
    """The table's lines, in its order; failed jobs count as a line that is not met."""
    sound = [e for e in entries if "error" not in e]
    lines: list[Line] = []
    for row in dict.fromkeys([*_LINES, "plain"]):
        own = [e for e in sound if e["row"] == row]
        if own:
            if row == "plain":
                lines += _plain(own, [e for e in sound if e["row"] == "first"])
            else:
                lines += _LINES[row](own)
        failed = [e for e in entries if e["row"] == row and "error" in e]
        if failed:
            lines.append(
                Line(
                    row,
                    f"{row}: jobs that failed",
                    float(len(failed)),
                    0.0,
                    False,
                    str(len(failed)),
                    "0",
                    "; ".join(dict.fromkeys(e["error"] for e in failed)),
                )
            )
    order = [*ROWS[:8], "checked", *ROWS[8:], "memory"]
    return sorted(lines, key=lambda line: order.index(line.row))
