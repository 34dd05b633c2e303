"""The evaluation's report: a summary in Markdown with its figures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks.evaluation.comparisons import REFERENCE, compare
from benchmarks.evaluation.figures import draw_by_scene, draw_overall
from benchmarks.evaluation.results import EvaluationResults
from benchmarks.evaluation.tables import (
    aims_table,
    difference_table,
    failure_table,
    first_solution_table,
    gap_table,
    level_table,
)
from benchmarks.text_table import TextTable
from benchmarks.variants import VARIANTS

_TITLE = "Evaluation of the placement planner"

Section = tuple[str, tuple[str, bytes] | None, TextTable | None]
"""Heading; name and PNG of a figure; table."""


def write_report(results: EvaluationResults, folder: Path) -> list[Path]:
    """Write `summary.md` with its figures as files; the files written."""
    figures: dict[str, bytes] = {}
    parts = [f"# {_TITLE}", "\n".join(f"- {line}" for line in _about_runs(results))]
    for heading, figure, table in _evaluation_sections(results):
        parts.append(f"## {heading}")
        if figure is not None:
            figures[f"figures/{figure[0]}.png"] = figure[1]
            parts.append(f"![{heading}](figures/{figure[0]}.png)")
        parts.append("" if table is None else table.markdown())
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    for name, picture in figures.items():
        (folder / name).write_bytes(picture)
    summary = "\n\n".join(part.strip() for part in parts if part) + "\n"
    (folder / "summary.md").write_text(summary, encoding="utf-8")
    return [folder / name for name in (*figures, "summary.md")]


def _evaluation_sections(results: EvaluationResults) -> Iterator[Section]:
    compared = (compare(results, v) for v in results.variants if v != REFERENCE)
    comparisons = [c for c in compared if c is not None]
    yield "Aims", None, aims_table(results, comparisons)
    yield "Relative objective over time", ("overall", draw_overall(results)), level_table(results)
    yield "By scene and objective", ("by_scene", draw_by_scene(results)), None
    yield "First placements", None, first_solution_table(results)
    if comparisons:
        yield "What each part contributes", None, difference_table(comparisons)
    yield "Gap to the best known", None, gap_table(results)
    failures = failure_table(results)
    yield "Runs without a placement", None, failures if failures.rows else None


def _about_runs(results: EvaluationResults) -> list[str]:
    """What was run, with what."""
    records = [record for group in results.runs.values() for record in group]
    lines = []
    for variant in results.variants:
        groups = [g for (_, name), g in results.runs.items() if name == variant]
        runs = sorted({len(group) for group in groups})
        limits = sorted({float(r["time_limit"]) for group in groups for r in group})
        lines.append(
            f"{variant} ({VARIANTS[variant].description}): {len(groups)} cases × "
            f"{_from_to(runs)} run{'' if runs == [1] else 's'} × {_from_to(limits)} s"
        )
    machines = {tuple(record["machine"].values()) for record in records}
    for processor, threads, system in sorted(machines, key=str):
        lines.append(f"Machine: {processor}, {threads} threads, {system}")
    for versions in {tuple(record["versions"].items()) for record in records}:
        lines.append("Versions: " + ", ".join(f"{name} {version}" for name, version in versions))
    return lines


def _from_to(values: list[float] | list[int]) -> str:
    low, high = f"{values[0]:g}", f"{values[-1]:g}"
    return low if low == high else f"{low} … {high}"
