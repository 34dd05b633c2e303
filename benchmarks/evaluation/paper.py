"""The paper's protocol: every variant on every case with several seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from benchmarks.cases import Case, all_cases
from benchmarks.record import Trial
from benchmarks.variants import PAPER_VARIANTS


@dataclass(frozen=True, slots=True)
class Preset:
    """How much is run.

    Attributes:
        seeds, seconds: runs per case and their time limit, for each variant but the baseline.
        baseline_seeds, baseline_seconds: the same of the baseline.
    """

    cases: tuple[Case, ...]
    seeds: int
    seconds: float
    baseline_seeds: int
    baseline_seconds: float


PRESETS: Mapping[str, Preset] = {
    "smoke": Preset(
        (
            Case("table", "small_crayons_box", "maximize_clearance"),
            Case("cabinet_low_clutter", "wine_glass", "minimize_clearance"),
        ),
        seeds=1,
        seconds=3.0,
        baseline_seeds=1,
        baseline_seconds=5.0,
    ),
    "quick": Preset(tuple(all_cases()), 5, 10.0, 2, 60.0),
    "full": Preset(tuple(all_cases()), 20, 120.0, 5, 60.0),
}


def preset_trials(preset: Preset, variants: Sequence[str] = PAPER_VARIANTS) -> list[Trial]:
    """Its trials seed by seed, so that a part of them is a smaller evaluation."""
    trials = []
    for seed in range(max(preset.seeds, preset.baseline_seeds)):
        for case in preset.cases:
            for variant in variants:
                baseline = variant == "baseline"
                if seed < (preset.baseline_seeds if baseline else preset.seeds):
                    seconds = preset.baseline_seconds if baseline else preset.seconds
                    trials.append(Trial(case, variant, seed, seconds))
    return trials
