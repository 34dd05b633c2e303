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


def _cases(names: str) -> tuple[Case, ...]:
    """Those of these names, as `table/wine_glass/max`, with blanks between."""
    parts = (name.split("/") for name in names.split())
    return tuple(Case(scene, thing, f"{sign}imize_clearance") for scene, thing, sign in parts)


_LONG = (
    "part_of_table/wine_glass/max table/toy_table/max table/small_crayons_box/min "
    "cabinet_low_clutter/large_crayons_box/max cabinet_low_clutter/toy_table/min "
    "cabinet_high_clutter/large_crayons_box/max cabinet_high_clutter/large_crayons_box/min "
    "cabinet_high_clutter/wine_glass/min"
)
PRESETS: Mapping[str, Preset] = {
    "smoke": Preset(
        _cases("table/wine_glass/max cabinet_low_clutter/toy_table/min"), 1, 3.0, 1, 5.0
    ),
    "quick": Preset(tuple(all_cases()), 5, 10.0, 2, 60.0),
    "full": Preset(tuple(all_cases()), 20, 120.0, 5, 60.0),
    "long": Preset(_cases(_LONG), 6, 60.0, 2, 60.0),
}
"""`long`: whether the yardstick holds where the best places are hard to reach."""


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
