"""The rows of the table: what each is, its target, and how it comes from raw entries."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.machine import machine, versions
from benchmarks.text_table import TextTable

Entry = dict[str, Any]

MADE_WITH = "made_with"
"""`row` of an entry that belongs to the rows it lists."""


def made_with(rows: Sequence[str]) -> Entry:
    """An entry that says what these rows were measured with, and on which day."""
    day = time.strftime("%Y-%m-%d")
    return {"row": MADE_WITH, "rows": list(rows), "day": day, **machine(), **versions()}


def median(values: Sequence[float]) -> float:
    """NaN of nothing."""
    return float(np.median(values)) if len(values) else float("nan")


def percentile(values: Sequence[float], share: float) -> float:
    """The value below which `share` percent of the values lie; NaN of nothing."""
    return float(np.percentile(values, share)) if len(values) else float("nan")


@dataclass(frozen=True, slots=True)
class SpeedLine:
    """One measured figure beside its target.

    Attributes:
        value: NaN where it could not be measured.
        shown: the value with its unit.
        wanted: the target with its unit, after >= where more is better.
        detail: over what it was measured, and what did not go well.
    """

    what: str
    value: float
    target: float
    shown: str
    wanted: str
    detail: str

    @property
    def told(self) -> str:
        """What was measured, in words."""
        return self.shown if math.isfinite(self.value) else "not measured"

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
    what: str, values: Sequence[float], target: float, unit: str, detail: str
) -> SpeedLine:
    """Rates or ratios over cases: the median counts, what 95 % of the cases exceed is told."""
    digits = ",.0f" if unit == " /s" else ".1f"
    middle, low = f"{median(values):{digits}}{unit}", f"{percentile(values, 5):{digits}}"
    shown = f"{middle} (95 % of the cases above {low}{unit.strip(' /s')})"
    wanted = f">= {target:,.0f}{unit}"
    return SpeedLine(what, median(values), target, shown, wanted, detail)


def _none_wanted(what: str, value: float, detail: str) -> SpeedLine:
    return SpeedLine(what, value, 0.0, f"{value:.0f}", "0", detail)


def _latency_lines(
    what: str, seconds: Sequence[float], limits: Mapping[int, float], detail: str
) -> list[SpeedLine]:
    """A line for each percentile that has a target, in milliseconds."""
    lines = []
    for share, target in limits.items():
        value = percentile(seconds, share)
        named = f"{what}, {'median' if share == 50 else f'{share:g} %'}"
        shown, wanted = f"{1e3 * value:,.0f} ms", f"<= {1e3 * target:,.0f} ms"
        lines.append(SpeedLine(named, value, target, shown, wanted, detail))
    return lines


def _call_lines(
    entries: Sequence[Entry], kind: str, what: str, limits: Mapping[int, float]
) -> list[SpeedLine]:
    """`_latency` of the entries of a kind; those that were not answered count at their limit."""
    own = [e for e in entries if e["kind"] == kind]
    if not own:
        return []
    seconds = [e["seconds"] for e in own]
    never = sum(not e.get("solved", True) or not e.get("told", True) for e in own)
    detail = f"{len(own)} times, slowest {1e3 * max(seconds):,.0f} ms"
    return _latency_lines(what, seconds, limits, detail + (f"; {never} never" if never else ""))


def _sum_of(entries: Sequence[Entry], key: str) -> float:
    return float(sum(entry[key] for entry in entries))


def _count_of(entries: Sequence[Entry], key: str) -> int:
    return int(_sum_of(entries, key))


def _share_of(part: float, whole: float) -> str:
    return f"{part / whole:.1%}" if whole else "none"


def _time_each(entries: Sequence[Entry], key: str, count: float) -> str:
    return f"{1e6 * _sum_of(entries, key) / count:.1f} µs" if count else "none measured"


def _part_times(entries: Sequence[Entry], *names: str) -> str:
    """Median milliseconds of each part."""
    return ", ".join(
        f"{name.replace('_', ' ')} {1e3 * median([e[f'{name}_seconds'] for e in entries]):.0f}"
        for name in names
    )


def _configurations_lines(entries: Sequence[Entry]) -> list[SpeedLine]:
    asked, free = _sum_of(entries, "queries"), _sum_of(entries, "free")
    rates = [e["queries"] / e["seconds"] for e in entries]
    detail = (
        f"{asked:,.0f} recorded configurations of {len(entries)} cases, "
        f"{_share_of(free, asked)} free; "
        f"{_time_each(entries, 'free_seconds', free)} for a free one, "
        f"{_time_each(entries, 'colliding_seconds', asked - free)} for a colliding one"
    )
    what = "configurations per second and core, fast tier"
    return [_over_cases(what, rates, 400_000.0, " /s", detail)]


def _edges_lines(entries: Sequence[Entry]) -> list[SpeedLine]:
    asked, certified = _sum_of(entries, "queries"), _sum_of(entries, "certified")
    missed = _sum_of(entries, "sampled_free") - certified + _sum_of(entries, "refuted")
    ratios = [e["exact_seconds"] / e["seconds"] for e in entries]
    detail = (
        f"{asked:,.0f} recorded edges, {_share_of(certified, asked)} certified free; coal refutes "
        f"{_count_of(entries, 'refuted')} of those, and finds {missed:.0f} free that are not "
        "certified"
    )
    what = "edges certified to the end, against coal every 5 mm"
    return [_over_cases(what, ratios, 30.0, "x", detail)]


def _samples_lines(entries: Sequence[Entry]) -> list[SpeedLine]:
    rates = [e["samples"] / e["seconds"] for e in entries]
    slowest = min(zip(rates, (e["case"] for e in entries), strict=True))
    detail = (
        f"{_count_of(entries, 'samples'):,} samples; slowest {slowest[1]}: {slowest[0]:,.0f} /s"
    )
    what = "goal samples tried per second in search"
    return [_over_cases(what, rates, 10_000.0, " /s", detail)]


def _clouds_lines(entries: Sequence[Entry]) -> list[SpeedLine]:
    lines = []
    for kind in dict.fromkeys(e["kind"] for e in entries):
        own = [e for e in entries if e["kind"] == kind]
        parts = _part_times(own, "environment", "clearance", "collision_field")
        detail = f"{len(own)} times over {len({e['scene'] for e in own})} scenes; ms: {parts}"
        detail += f"; CPU {1e3 * median([e['cpu_seconds'] for e in own]):.0f}"
        what = f"{kind} cloud of {own[0]['points']:,} points to obstacle set, regions and fields"
        slowest = {50: 0.25, 95: 0.25}
        lines += _latency_lines(what, [e["seconds"] for e in own], slowest, detail)
    return lines


def first_seconds(entry: Entry, *, environment: bool) -> float:
    """Seconds to the first placement; a run without one takes its limit at least."""
    seconds = float(entry["planner_seconds"] + entry["search_seconds"])
    if environment:
        seconds += entry["environment_seconds"]
    return seconds if entry["solved"] else max(seconds, float(entry["limit"]))


def _first_lines(entries: Sequence[Entry]) -> list[SpeedLine]:
    lines = []
    unsolved = sum(not e["solved"] for e in entries)
    parts = _part_times(entries, "environment", "planner", "search")
    cpu = 1e3 * median([e["cpu_seconds"] for e in entries])
    detail = f"{len(entries)} runs, {unsolved} unsolved; median ms: {parts}"
    detail += f"; CPU of planner and search {cpu:.0f}"
    for name, environment in (("environment ready", False), ("environment built from it", True)):
        seconds = [first_seconds(e, environment=environment) for e in entries]
        what = f"first placement from the start call, {name}"
        lines += _latency_lines(what, seconds, {50: 0.25, 95: 1.0}, detail)
    return lines


def _checked_lines(entries: Sequence[Entry]) -> list[SpeedLine]:
    refused, checked = _sum_of(entries, "refused"), _sum_of(entries, "checked")
    detail = f"{checked:.0f} first placements looked at by test/checker"
    what = "first placements that the independent checker refuses"
    return [_none_wanted(what, refused if checked else math.nan, detail)]


def _node_lines(entries: Sequence[Entry]) -> list[SpeedLine]:
    services = "node: answers of other services during a search"
    return [
        *_call_lines(entries, "start", "node: answer of ~/start", {50: 0.1, 95: 0.1}),
        *_call_lines(entries, "service", services, {50: 0.02}),
        *_call_lines(entries, "stop", "node: from the stop call to its answer", {50: 0.1, 99: 0.1}),
        *_call_lines(
            entries, "first", "node: from the start call to ~/solution", {50: 0.25, 95: 1.0}
        ),
    ]


def _load_lines(entries: Sequence[Entry]) -> list[SpeedLine]:
    """The node beside three clouds of 300,000 points at 10 Hz."""
    beside = "beside 3 clouds at 10 Hz"
    lines = [
        *_call_lines(entries, "start", f"{beside}: answer of ~/start", {50: 0.1, 99: 0.1}),
        *_call_lines(
            entries, "stop", f"{beside}: from the stop call to its answer", {50: 0.1, 99: 0.1}
        ),
    ]
    turns = [e for e in entries if e["kind"] == "samples"]
    if turns:
        alone, loaded = (_sum_of(turns, key) / len(turns) for key in ("without", "beside"))
        fall = 100.0 * (1.0 - loaded / alone)
        what = "samples per second that 3 clouds at 10 Hz cost a search"
        detail = f"{alone:,.0f} /s without them and {loaded:,.0f} /s beside them, in turns"
        lines.append(SpeedLine(what, fall, 25.0, f"{fall:.0f} %", "<= 25 %", detail))
    return lines


def slope_per_hour(seconds: Sequence[float], values: Sequence[float]) -> float:
    """Of a straight line through the last four fifths of the points, in units per hour."""
    skipped = len(seconds) // 5
    if len(seconds) - skipped < 3:
        return math.nan
    return float(np.polyfit(seconds[skipped:], values[skipped:], 1)[0] * 3600.0)


def _memory_lines(entries: Sequence[Entry]) -> list[SpeedLine]:
    seconds, used = [e["time"] for e in entries], [e["bytes"] / 1e6 for e in entries]
    detail = (
        f"{(seconds[-1] - seconds[0]) / 60:.1f} minutes of one search, {len(used)} readings; "
        f"{used[0]:.0f} MB at its start, {used[-1]:.0f} MB at its end, "
        f"slope {slope_per_hour(seconds, used):+.0f} MB per hour after the first fifth"
    )
    what, most = "resident memory of the node in a search, most", max(used)
    return [SpeedLine(what, most, 700.0, f"{most:.0f} MB", "<= 700 MB", detail)]


_LINES: dict[str, Callable[[Sequence[Entry]], list[SpeedLine]]] = {
    "configurations": _configurations_lines,
    "edges": _edges_lines,
    "samples": _samples_lines,
    "clouds": _clouds_lines,
    "first": _first_lines,
    "checked": _checked_lines,
    "node": _node_lines,
    "memory": _memory_lines,
    "load": _load_lines,
}
"""Row -> its lines, in the table's order."""

ROWS = tuple(row for row in _LINES if row not in ("checked", "memory"))
"""What can be chosen; `first` brings the checker's answers, `node` its memory."""


def lines_of(entries: Sequence[Entry]) -> list[SpeedLine]:
    """The table's lines, in its order; failed jobs count as a line that is not met."""
    lines: list[SpeedLine] = []
    for row, make in _LINES.items():
        own = [e for e in entries if e["row"] == row and "error" not in e]
        if own:
            lines += make(own)
        failed = [e["error"] for e in entries if e["row"] == row and "error" in e]
        if failed:
            why = "; ".join(dict.fromkeys(failed))
            lines.append(_none_wanted(f"{row}: jobs that failed", float(len(failed)), why))
    return lines


def speed_table(lines: Sequence[SpeedLine], entries: Sequence[Entry]) -> str:
    """The table as Markdown, and below it what it was measured with."""
    rows = [
        (line.what, line.told, line.wanted, "yes" if line.met else "**no**", line.detail)
        for line in lines
    ]
    notes = [
        f"{sum(line.met for line in lines)} of {len(lines)} targets met. Rates and ratios are of "
        "CPU time of one core (`time.process_time`), medians over cases; latencies are wall time. "
        "Runs and queries without an answer count at their limit."
    ]
    for made in (entry for entry in entries if entry["row"] == MADE_WITH):
        told = [f"{key} {value}" for key, value in made.items() if key not in ("row", "rows")]
        notes.append(f"{', '.join(made['rows'])} measured with: {', '.join(told)}.")
    header = ("what", "measured", "target", "met", "over")
    return TextTable(header, rows, "\n\n".join(notes)).markdown()
