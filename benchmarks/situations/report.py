"""What the recorded runs say: a table with a row for each situation, and how many were right."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.cases import in_words
from benchmarks.record import last_line
from benchmarks.situations.runs import OUTCOMES, job_key, outcome
from benchmarks.situations.situation import CLOUDS
from benchmarks.text_table import TextTable

Entry = Mapping[str, Any]
VERDICTS_FILE = "verdicts.jsonl"
"""What `test/by_hand/verify_situations.py` writes beside the runs: a line for each placement."""

_WORDS = {"complete": "complete cloud", "camera": "one camera"}


def situations_report(entries: Sequence[Entry], verdicts: Sequence[Entry]) -> str:
    """Counts, what was wrong, and the table."""
    parts = [
        _count_table(entries, verdicts),
        _wrong_runs(entries, verdicts),
        _table_of_runs(entries),
    ]
    commits = ", ".join(sorted({entry["versions"]["commit"] for entry in entries}))
    limits = ", ".join(f"{each:g}" for each in sorted({e["time_limit"] for e in entries}))
    seeds = ", ".join(map(str, sorted({entry["seed"] for entry in entries})))
    made = f"Of commit {commits}; seeds {seeds}; {limits} s of processor time a run at most."
    return "\n".join([made, "", *(part for part in parts if part)])


def _count_table(entries: Sequence[Entry], verdicts: Sequence[Entry]) -> str:
    """A row for each kind of cloud, and what became of the placements."""
    rows = []
    for cloud in CLOUDS:
        own = [entry for entry in entries if entry["cloud"] == cloud]
        if not own:
            continue
        count = Counter(map(outcome, own))
        right = f"{count['right']} ({100.0 * count['right'] / len(own):.1f} %)"
        others = [str(count[each]) for each in OUTCOMES[1:]]
        none = [entry for entry in own if not entry["possible"]]
        proven = f"{sum(entry['exhausted'] for entry in none)} of {len(none)}"
        rows.append((_WORDS[cloud], str(len(own)), right, *others, proven))
    header = ("", "runs", "right", *OUTCOMES[1:], "of the impossible, proven")
    parts = [TextTable(header, rows).markdown()]
    times = [entry["solutions"][0]["time"] for entry in entries if entry["solutions"]]
    if times:
        middle, most = np.median(times), max(times)
        parts.append(f"First placement: median {middle:.2f} s, latest {most:.2f} s.\n")
    if verdicts:
        refused = sum(bool(each["refused"]) for each in verdicts)
        fallen = sum(not each["stays"] for each in verdicts)
        told = f"Of {len(verdicts)} placements the checker refuses {refused or 'none'}; released "
        parts.append(f"{told}in mujoco, {fallen or 'none'} moved by 5 mm or tilted by 2°.\n")
    return "\n".join(parts)


def _wrong_runs(entries: Iterable[Entry], verdicts: Iterable[Entry]) -> str:
    """A line for each run that was wrong, and for each placement that is."""
    lines = []
    for entry in entries:
        said = outcome(entry)
        if said != "right":
            why = last_line(entry["failure"]) or entry["why"]
            lines.append(f"- `{job_key(entry)}`: {said}. {why}")
    for each in verdicts:
        told = list(each["refused"])
        if not each["stays"]:
            told.append(f"moves {1e3 * each['moved']:.1f} mm, tilts {each['tilted']:.1f}°")
        if told:
            lines.append(f"- `{each['run']}`, placement {each['number']}: {'; '.join(told)}")
    return "\n".join(["Wrong:", "", *lines]) + "\n" if lines else ""


def _table_of_runs(entries: Sequence[Entry]) -> str:
    """Markdown: the true answer, and what the planner said."""
    rows = []
    by_name: dict[str, list[Entry]] = {}
    for entry in entries:
        by_name.setdefault(entry["name"], []).append(entry)
    for name, own in by_name.items():
        first = next((e for e in own if e["cloud"] == "complete"), own[0])
        truth = "possible" if first["possible"] else "impossible"
        if first["pose_exists"] and not first["possible"]:
            truth = "a pose, but the robot cannot"
        cells = [in_words(name), in_words(first["thing"]), first["support"]]
        cells.append(f"{truth}: {first['why']}")
        cells += [
            _what_was_said([e for e in own if e["cloud"] == cloud], first) for cloud in CLOUDS
        ]
        rows.append(cells)
    header = ("situation", "object", "s(x)", "true answer", "complete cloud", "one camera")
    return TextTable(header, rows).markdown()


def _what_was_said(runs: Sequence[Entry], first: Entry) -> str:
    """What was said, how often, and where it was wrong; the truth where the camera's differs."""
    told: Counter[str] = Counter()
    for run in runs:
        said = "placed" if run["solutions"] else "proven" if run["exhausted"] else "nothing found"
        told[said if outcome(run) == "right" else f"**{said}**"] += 1
    words = ", ".join(f"{said} {count}" if count > 1 else said for said, count in told.items())
    if runs and runs[0]["possible"] != first["possible"]:
        truth = "possible" if runs[0]["possible"] else "impossible"
        words += f" ({truth} for it{runs[0]['why'].removeprefix(first['why'])})"
    return words
