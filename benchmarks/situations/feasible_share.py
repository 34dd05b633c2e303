"""How many random poses on a table are feasible when it is off level, beside those on it level."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.machine import versions
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.problem import Problem, workspace
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import Array, Verdict, upright
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.objects import OBJECT_NAMES, object_by_name
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import load_yumi, start_configuration, yumi_arm

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
    robot, held = load_yumi(), object_by_name(name)
    arms = tuple(yumi_arm(robot, arm, grasps) for arm, grasps in held.grasps.items())
    q_start = robot.configuration(start_configuration(name))
    body = Body.from_mesh(held.vertices, held.triangles, held.center_of_mass)
    bounds = workspace(robot, arms, q_start, body, volume)
    environment = Environment.from_points(turned, volume, bounds=bounds, beyond_volume=False)
    problem = Problem(robot, arms, q_start, body, volume, environment)
    settings = PlannerSettings()
    constraints = PoseConstraints(
        problem, settings.collision, settings.footing, settings.approach.approach_minimum
    )
    region = environment.regions[0]
    rng = np.random.default_rng(seed)
    xy = rng.uniform(volume.lower[:2], volume.upper[:2], (poses, 2))
    contacts = np.column_stack([xy, region.heights(xy)])
    faces = rng.integers(len(body.faces), size=poses)
    angles = rng.uniform(-np.pi, np.pi, poses)
    slopes = np.tile(region.slope, (poses, 1))
    verdicts = constraints.verdicts(faces, contacts, angles, slopes)[0]
    return float((verdicts == Verdict.FEASIBLE).mean())


def shares_table(entries: Sequence[Mapping[str, Any]]) -> str:
    """Markdown: a row for each object, the shares of the turned table beside the level one's."""
    if not entries:
        return ""
    turns = [f"{azimuth:g}°" for azimuth in AZIMUTHS]
    rows = [f"| object | table | level | {' | '.join(f'rising at {t}' for t in turns)} |"]
    rows.append("|---" * (len(turns) + 3) + "|")
    keys = dict.fromkeys((entry["thing"], entry["table"]) for entry in entries)
    for thing, words in keys:
        own = [e for e in entries if (e["thing"], e["table"]) == (thing, words)]
        cells = [thing.replace("_", " "), words, f"{own[0]['level']:.3f}"]
        cells += [f"{e['share']:.3f} ({e['share'] / e['level']:.2f})" for e in own]
        rows.append(f"| {' | '.join(cells)} |")
    below = sum(e["share"] < LEAST * e["level"] for e in entries)
    commit = entries[-1]["versions"]["commit"]
    rows += [
        "",
        f"Of commit {commit}: shares of {entries[0]['poses']} random poses that are in V, "
        f"stable and free, on a table {DEGREES:g}° off level; {below} of {len(entries)} are below "
        f"{LEAST:g} of the level table's.",
    ]
    return "\n".join(rows) + "\n"
