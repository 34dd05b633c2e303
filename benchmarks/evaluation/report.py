"""The evaluation's report: one self-contained page, its figures, and a summary in Markdown."""

from __future__ import annotations

import base64
import html
import io
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from PIL import Image

from benchmarks.cases import Case, case_label
from benchmarks.evaluation.comparisons import REFERENCE, compare
from benchmarks.evaluation.figures import (
    draw_by_scene,
    draw_differences,
    draw_first_solutions,
    draw_gaps,
    draw_overall,
    draw_rejections,
)
from benchmarks.evaluation.results import Record, Results
from benchmarks.evaluation.tables import (
    Table,
    aims_table,
    difference_table,
    failure_table,
    first_solution_table,
    gap_table,
    level_table,
    rate_table,
)
from benchmarks.scaling.growth import growths
from benchmarks.scaling.report import draw_scaling, scaling_table
from benchmarks.variants import VARIANTS
from placement_planner_ros.pictures.picture import draw_placement
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
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(330px, 1fr)); gap: 1em; }
figure { margin: 0; } figcaption { font-size: 13px; }
"""

Section = tuple[str, tuple[str, bytes] | None, Table | None]
"""Heading; name and PNG of a figure; table."""


def write_report(
    results: Results,
    folder: Path,
    pictures: bool = True,
    scaling: Sequence[Mapping[str, Any]] = (),
) -> list[Path]:
    """Write `report.html`, `summary.md` and the figures as files.

    Args:
        pictures: whether the page shows the best placement of each case.
        scaling: records of `python -m benchmarks scaling`, if any.

    Returns:
        The files written.
    """
    sections = [*_sections(results), *_scaling_sections(scaling)]
    figures = folder / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    written = []
    for _, figure, _ in sections:
        if figure is not None:
            written.append(figures / f"{figure[0]}.png")
            written[-1].write_bytes(figure[1])
    page = "".join(_page_section(section) for section in sections)
    if pictures:
        page += _gallery(results)
    title = "Evaluation of the placement planner"
    written.append(folder / "report.html")
    written[-1].write_text(
        f"<!doctype html><html lang='en'><head><meta charset='utf-8'><title>{title}</title>"
        f"<style>{_STYLE}</style></head><body><h1>{title}</h1>{_about_page(results)}{page}"
        "</body></html>\n",
        encoding="utf-8",
    )
    written.append(folder / "summary.md")
    written[-1].write_text(_summary(results, sections), encoding="utf-8")
    return written


def _sections(results: Results) -> Iterator[Section]:
    compared = (compare(results, v) for v in results.variants if v != REFERENCE)
    comparisons = [c for c in compared if c is not None]
    yield "Aims", None, aims_table(results, comparisons)
    yield "Relative objective over time", ("overall", draw_overall(results)), level_table(results)
    yield "By scene and objective", ("by_scene", draw_by_scene(results)), None
    first = ("first_solutions", draw_first_solutions(results))
    yield "First placements", first, first_solution_table(results)
    if comparisons:
        differences = ("differences", draw_differences(comparisons, results))
        yield "What each part contributes", differences, difference_table(comparisons)
    yield "Where samples are rejected", ("rejections", draw_rejections(results)), None
    yield "Samples per second", None, rate_table(results)
    yield "Gap to the best known", ("gaps", draw_gaps(results)), gap_table(results)
    failures = failure_table(results)
    yield "Runs without a placement", None, failures if failures.rows else None


def _scaling_sections(records: Sequence[Mapping[str, Any]]) -> Iterator[Section]:
    found = growths(records)
    if found:
        yield "How time grows", ("scaling", draw_scaling(found)), scaling_table(found)


def _about(results: Results) -> list[str]:
    """What was run, with what."""
    records = [record for group in results.runs.values() for record in group]
    lines = []
    for variant in results.variants:
        groups = [g for (_, name), g in results.runs.items() if name == variant]
        runs = sorted({len(group) for group in groups})
        limits = sorted({float(r["time_limit"]) for group in groups for r in group})
        lines.append(
            f"{variant} ({VARIANTS[variant].description}): {len(groups)} cases × "
            f"{_range(runs)} run{'' if runs == [1] else 's'} × {_range(limits)} s"
        )
    machines = {tuple(record["machine"].values()) for record in records}
    for processor, threads, system in sorted(machines, key=str):
        lines.append(f"Machine: {processor}, {threads} threads, {system}")
    for versions in {tuple(record["versions"].items()) for record in records}:
        lines.append("Versions: " + ", ".join(f"{name} {version}" for name, version in versions))
    return lines


def _range(values: list[float] | list[int]) -> str:
    low, high = f"{values[0]:g}", f"{values[-1]:g}"
    return low if low == high else f"{low} … {high}"


def _about_page(results: Results) -> str:
    return "<ul>" + "".join(f"<li>{html.escape(line)}</li>" for line in _about(results)) + "</ul>"


def _page_section(section: Section) -> str:
    heading, figure, table = section
    image = "" if figure is None else _image(figure[1], heading)
    content = image + ("" if table is None else table.page())
    return f"<h2>{html.escape(heading)}</h2>{content or '<p>None.</p>'}"


def _summary(results: Results, sections: list[Section]) -> str:
    parts = ["\n".join(f"- {line}" for line in _about(results)) + "\n"]
    for heading, figure, table in sections:
        image = "" if figure is None else f"![{heading}](figures/{figure[0]}.png)\n\n"
        content = image + ("" if table is None else table.markdown())
        parts.append(f"## {heading}\n\n{content or 'None.'}".rstrip() + "\n")
    return "\n".join(parts)


def _gallery(results: Results) -> str:
    entries = []
    for case in results.cases:
        best = results.best_run(case)
        if best is not None:
            caption = (
                f"{case_label(case)}: ξ = {best['solutions'][-1]['objective']:+.4f} m "
                f"({best['variant']}, seed {best['seed']}, "
                f"{best['solutions'][-1]['time']:.1f} s)"
            )
            picture = _image(_picture(case, best), caption)
            entries.append(
                f"<figure>{picture}<figcaption>{html.escape(caption)}</figcaption></figure>"
            )
    return f"<h2>Best placements</h2><div class='pictures'>{''.join(entries)}</div>"


def _picture(case: Case, record: Record) -> bytes:
    """A PNG of the last placement of a run, small enough to put two dozen on a page."""
    solution = record["solutions"][-1]
    robot, held = load_yumi(), object_by_name(case.object)
    arm = yumi_arm(robot, solution["arm"])
    q = robot.configuration(start_configuration(case.object, solution["arm"]))
    q[arm.q_index] = solution["q"]
    pose = np.array(solution["pose"])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "placement.png"
        draw_placement(
            path,
            robot=robot,
            q=q,
            body_vertices=held.vertices,
            body_triangles=held.triangles,
            T_world_object=pin.SE3(pose[:, :3], pose[:, 3]),
            scene=scene_by_name(case.scene),
            hand_links=arm.touch_links,
        )
        with Image.open(path) as image:
            height = round(image.height * _PICTURE_WIDTH / image.width)
            small = image.convert("RGB").resize((_PICTURE_WIDTH, height), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    small.quantize(_PICTURE_COLOURS, Image.Quantize.MAXCOVERAGE).save(
        buffer, format="PNG", optimize=True
    )
    return buffer.getvalue()


def _image(png: bytes, description: str) -> str:
    data = base64.b64encode(png).decode("ascii")
    return f"<img alt='{html.escape(description)}' src='data:image/png;base64,{data}'>"
