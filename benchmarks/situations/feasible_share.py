"""How many random poses on a table are feasible when it is off level, beside those on it level."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.cases import build_problem, in_words, inputs_of
from benchmarks.machine import versions
from benchmarks.text_table import TextTable
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.types import Array, Verdict, upright
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.objects import OBJECT_NAMES
from placement_planner_ros.scenes.scenes import scene_by_name

SHARES_FILE = "feasible_shares.jsonl"
DEGREES, AZIMUTHS = 3.0, (0.0, 90.0, 45.0)
"""Of the table, and towards where it rises."""
LEAST = 0.9
"""Of the level table's share."""


def measure_shares(poses: int, seed: int) -> Iterator[dict[str, Any]]:
    """Feasible shares of that many poses on the bundled table, bare and with what stands on it."""
    scene = scene_by_name("table")
    bare = replace(scene, parts=scene.parts[:1])
    for name in OBJECT_NAMES:
        for words, each in (("bare", bare), ("with things", scene)):
            points = complete_cloud(each)
            level = _share(points, each.volume, name, 0.0, 0.0, poses, seed)
            for azimuth in AZIMUTHS:
                turned = _share(points, each.volume, name, DEGREES, azimuth, poses, seed)
                yield {
                    "thing": name,
                    "table": words,
                    "degrees": DEGREES,
                    "azimuth": azimuth,
                    "poses": poses,
                    "level": level,
                    "share": turned,
                    "versions": versions(),
                }


def _share(
    points: Array, volume: Any, name: str, degrees: float, azimuth: float, poses: int, seed: int
) -> float:
    """Of random rests, places of the contact point in V and turns on the largest region's plane."""
    steep, towards = np.tan(np.radians(degrees)), np.radians(azimuth)
    slope = float(steep * np.cos(towards)), float(steep * np.sin(towards))
    pivot = np.array([*(0.5 * (volume.lower + volume.upper)[:2]), 0.0])
    turned = (points - pivot) @ upright(slope).T + pivot
    problem, _ = build_problem(inputs_of(name, volume, turned), "maximize_clearance")
    settings = PlannerSettings()
    constraints = PoseConstraints(
        problem, settings.collision, settings.footing, settings.approach.approach_minimum
    )
    region = problem.environment.regions[0]
    rng = np.random.default_rng(seed)
    xy = rng.uniform(volume.lower[:2], volume.upper[:2], (poses, 2))
    contacts = np.column_stack([xy, region.heights(xy)])
    faces = rng.integers(len(problem.body.faces), size=poses)
    angles = rng.uniform(-np.pi, np.pi, poses)
    slopes = np.tile(region.slope, (poses, 1))
    verdicts = constraints.verdicts(faces, contacts, angles, slopes)[0]
    return float((verdicts == Verdict.FEASIBLE).mean())


def shares_table(entries: Sequence[Mapping[str, Any]]) -> str:
    """Markdown: a row for each object, the shares of the turned table beside the level one's."""
    if not entries:
        return ""
    rows = []
    for thing, on in dict.fromkeys((entry["thing"], entry["table"]) for entry in entries):
        own = [e for e in entries if (e["thing"], e["table"]) == (thing, on)]
        turned = (f"{e['share']:.3f} ({e['share'] / e['level']:.2f})" for e in own)
        rows.append((in_words(thing), on, f"{own[0]['level']:.3f}", *turned))
    below = sum(e["share"] < LEAST * e["level"] for e in entries)
    note = (
        f"Of commit {entries[-1]['versions']['commit']}: shares of {entries[0]['poses']} random "
        f"poses that are in V, stable and free, on a table {DEGREES:g}° off level; {below} of "
        f"{len(entries)} are below {LEAST:g} of the level table's."
    )
    header = ("object", "table", "level", *(f"rising at {azimuth:g}°" for azimuth in AZIMUTHS))
    return TextTable(header, rows, note).markdown()
