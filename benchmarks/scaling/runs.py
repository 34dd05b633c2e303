"""How planning time grows with V, with the cloud and with clutter, each doubled three times."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.cases import OBJECTIVES, Case, CaseInputs, build_problem, read_inputs
from benchmarks.record import Trial, describe_run, run_trial
from benchmarks.scaling.cluttered_table import cluttered_table
from benchmarks.variants import VARIANTS
from benchmarks.yardstick.dense_search import sampled_placements
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.clouds import complete_cloud

FACTORS = (1, 2, 4, 8)
AXES: Mapping[str, str] = {
    "volume": "target volume",
    "cloud": "points of the cloud",
    "clutter": "things on the table",
}
"""What is doubled -> in words."""
SCALING_FILE = "scaling.jsonl"

_OBJECT = "small_crayons_box"
_THINGS = 8
_MOST_SPACING = 0.006
_RANDOM_PLACEMENTS = 100
_RANDOM_SECONDS = 20.0


@dataclass(frozen=True, slots=True)
class ScalingJob:
    """One run on the table with one thing scaled.

    Where they are not scaled, V is the table's whole target volume, the cloud has points every
    6 mm, and eight things stand on the table.

    Attributes:
        axis: one of `AXES`.
        factor: V is factor / 8 of the table's, the cloud has factor times the points, or
            2 · factor things stand on the table.
        trial: what is run there.
    """

    axis: str
    factor: int
    trial: Trial

    @property
    def work(self) -> float:
        """Seconds at most."""
        return self.trial.work

    @property
    def key(self) -> str:
        """Tells jobs apart."""
        return f"{self.axis} x{self.factor} {self.trial.key}"


def scaling_jobs(seeds: int, seconds: float, axes: tuple[str, ...] = ()) -> list[ScalingJob]:
    """Every setting once per seed, so that a part of them is a smaller experiment."""
    variant = next(iter(VARIANTS))
    return [
        ScalingJob(axis, factor, Trial(Case("table", _OBJECT, objective), variant, seed, seconds))
        for seed in range(seeds)
        for axis in axes or tuple(AXES)
        for factor in FACTORS
        for objective in OBJECTIVES
    ]


def describe_scaling(record: Mapping[str, Any]) -> str:
    """One line for the terminal."""
    return f"{record['axis']:<8} x{record['factor']} {describe_run(record)}"


def scaled_volume(volume: TargetVolume, factor: int) -> TargetVolume:
    """factor / 8 of the volume about its middle: y is halved first, then x, then y again."""
    halvings = len(FACTORS) - 1 - FACTORS.index(factor)
    share = np.array([0.5 ** (halvings // 2), 0.5 ** ((halvings + 1) // 2), 1.0])
    middle, half = (volume.lower + volume.upper) / 2, (volume.upper - volume.lower) / 2
    return TargetVolume(middle - share * half, middle + share * half)


@functools.lru_cache(maxsize=4)
def scaled_inputs(axis: str, factor: int) -> CaseInputs:
    """Robot, object, cloud and V of one setting."""
    inputs = read_inputs(Case("table", _OBJECT, OBJECTIVES[0]), np.random.default_rng(0))
    scene = cluttered_table(2 * factor if axis == "clutter" else _THINGS)
    spacing = _MOST_SPACING / np.sqrt(factor if axis == "cloud" else 1)
    volume = scaled_volume(scene.volume, factor) if axis == "volume" else scene.volume
    return replace(inputs, volume=volume, points=complete_cloud(scene, float(spacing)))


def run_scaling(job: ScalingJob) -> dict[str, Any]:
    """What `run_trial` makes, also of a run that failed.

    Further keys: axis, factor, size (m³, points, or things), random (median ξ of random feasible
    placements, None where there is none).
    """
    extra: dict[str, Any] = {"axis": job.axis, "factor": job.factor, "size": None, "random": None}

    def inputs(case: Case, _: np.random.Generator) -> CaseInputs:
        found = scaled_inputs(job.axis, job.factor)
        extra["size"] = _size_of(job, found)
        extra["random"] = random_value(job.axis, job.factor, case.objective)
        return found

    record = run_trial(job.trial, inputs)
    return {**extra, **record}


def _size_of(job: ScalingJob, inputs: CaseInputs) -> float:
    if job.axis == "volume":
        return float(np.prod(inputs.volume.upper - inputs.volume.lower))
    return float(len(inputs.points) if job.axis == "cloud" else 2 * job.factor)


@functools.cache
def random_value(axis: str, factor: int, objective: str) -> float | None:
    """Median ξ of random feasible placements."""
    problem, objective_function = build_problem(scaled_inputs(axis, factor), objective)
    settings = replace(PlannerSettings(), sampler="uniform")
    planner = PlacementPlanner(problem, objective_function, settings, np.random.default_rng(0))
    values = sampled_placements(planner, _RANDOM_PLACEMENTS, _RANDOM_SECONDS)
    return float(np.median(values)) if len(values) else None
