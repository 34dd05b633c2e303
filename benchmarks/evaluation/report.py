"""The evaluation's report: one self-contained page, its figures, and a summary in Markdown."""

from __future__ import annotations

import base64
import io
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from markdown_it import MarkdownIt
from PIL import Image

from benchmarks.cases import Case, case_label
from benchmarks.drawing.panels import draw_solution
from benchmarks.evaluation.comparisons import REFERENCE, compare
from benchmarks.evaluation.figures import draw_by_scene, draw_differences, draw_overall
from benchmarks.evaluation.results import EvaluationResults, RunEntry
from benchmarks.evaluation.tables import (
    aims_table,
    difference_table,
    failure_table,
    first_solution_table,
    gap_table,
    level_table,
    rate_table,
    rejection_table,
)
from benchmarks.scaling.growth import growths
from benchmarks.scaling.report import draw_scaling, scaling_table
from benchmarks.text_table import TextTable
from benchmarks.variants import VARIANTS
from placement_planner_ros.pictures.picture import robot_meshes
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import load_yumi, start_configuration, yumi_arm

_PICTURE_WIDTH = 660
_PICTURE_COLOURS = 256
_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1120px; margin: 2em auto; padding: 0 1em; }
img { max-width: 100%; display: block; margin: 0.5em 0; }
table { border-collapse: collapse; margin: 0.5em 0; font-size: 13px; }
td, th { border-bottom: 1px solid #ccc; padding: 3px 10px; text-align: left; }
"""

_TITLE = "Evaluation of the placement planner"

Section = tuple[str, tuple[str, bytes] | None, TextTable | None]
"""Heading; name and PNG of a figure; table."""


def write_report(
    results: EvaluationResults,
    folder: Path,
    pictures: bool = True,
    scaling: Sequence[Mapping[str, Any]] = (),
) -> list[Path]:
    """Write `summary.md` with its figures as files, and both as one page, `report.html`.

    Args:
        pictures: whether the page shows the best placement of each case.
        scaling: records of `python -m benchmarks scaling`, if any.

    Returns:
        The files written.
    """
    figures: dict[str, bytes] = {}
    parts = [f"# {_TITLE}", "\n".join(f"- {line}" for line in _about_runs(results))]
    for heading, figure, table in [*_evaluation_sections(results), *_scaling_sections(scaling)]:
        parts.append(f"## {heading}")
        if figure is not None:
            figures[f"figures/{figure[0]}.png"] = figure[1]
            parts.append(f"![{heading}](figures/{figure[0]}.png)")
        parts.append("" if table is None else table.markdown())
    if pictures:
        parts.append("## Best placements")
        for caption, picture in _best_placements(results):
            name = f"figures/placement_{len(figures)}.png"
            figures[name] = picture
            parts.append(f"![{caption}]({name})\n\n{caption}")
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    for name, picture in figures.items():
        (folder / name).write_bytes(picture)
    summary = "\n\n".join(part.strip() for part in parts if part) + "\n"
    (folder / "summary.md").write_text(summary, encoding="utf-8")
    (folder / "report.html").write_text(_html_page(summary, figures), encoding="utf-8")
    return [folder / name for name in (*figures, "summary.md", "report.html")]


def _html_page(summary: str, figures: Mapping[str, bytes]) -> str:
    """The summary as HTML with its figures in it."""
    content = MarkdownIt("commonmark").enable("table").render(summary)
    for name, picture in figures.items():
        data = base64.b64encode(picture).decode("ascii")
        content = content.replace(f'src="{name}"', f'src="data:image/png;base64,{data}"')
    head = f"<meta charset='utf-8'><title>{_TITLE}</title><style>{_STYLE}</style>"
    return f"<!doctype html><html lang='en'><head>{head}</head><body>{content}</body></html>\n"


def _evaluation_sections(results: EvaluationResults) -> Iterator[Section]:
    compared = (compare(results, v) for v in results.variants if v != REFERENCE)
    comparisons = [c for c in compared if c is not None]
    yield "Aims", None, aims_table(results, comparisons)
    yield "Relative objective over time", ("overall", draw_overall(results)), level_table(results)
    yield "By scene and objective", ("by_scene", draw_by_scene(results)), None
    yield "First placements", None, first_solution_table(results)
    if comparisons:
        differences = ("differences", draw_differences(comparisons, results))
        yield "What each part contributes", differences, difference_table(comparisons)
    yield "Where samples are rejected", None, rejection_table(results)
    yield "Samples per second", None, rate_table(results)
    yield "Gap to the best known", None, gap_table(results)
    failures = failure_table(results)
    yield "Runs without a placement", None, failures if failures.rows else None


def _scaling_sections(records: Sequence[Mapping[str, Any]]) -> Iterator[Section]:
    found = growths(records)
    if found:
        yield "How time grows", ("scaling", draw_scaling(found)), scaling_table(found)


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


def _best_placements(results: EvaluationResults) -> Iterator[tuple[str, bytes]]:
    """Caption and PNG of each case's best placement."""
    for case in results.cases:
        best = results.best_run(case)
        if best is not None:
            last = best["solutions"][-1]
            caption = f"{case_label(case)}: ξ = {last['objective']:+.4f} m "
            caption += f"({best['variant']}, seed {best['seed']}, {last['time']:.1f} s)"
            yield caption, _placement_picture(case, best)


def _placement_picture(case: Case, record: RunEntry) -> bytes:
    """A PNG of the last placement of a run, small enough to put two dozen on a page."""
    solution = record["solutions"][-1]
    robot, held = load_yumi(), object_by_name(case.object)
    arm = yumi_arm(robot, solution["arm"])
    q = robot.configuration(start_configuration(case.object, solution["arm"]))
    q[arm.q_index] = solution["q"]
    pose = np.array(solution["pose"])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "placement.png"
        draw_solution(
            path,
            scene_by_name(case.scene),
            held,
            pin.SE3(pose[:, :3], pose[:, 3]),
            robot_meshes(robot, q, arm.touch_links),
        )
        with Image.open(path) as image:
            small = image.convert("RGB")
        small.thumbnail((_PICTURE_WIDTH, _PICTURE_WIDTH))
    buffer = io.BytesIO()
    small.quantize(_PICTURE_COLOURS).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()
