"""Recorded runs and yardsticks, read back and brought to one scale."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.cases import Case
from benchmarks.evaluation.relative import Scale
from benchmarks.json_lines import read_lines
from benchmarks.variants import VARIANTS
from placement_planner_ros.core.errors import ParameterError

RunEntry = Mapping[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class EvaluationResults:
    """The runs of an evaluation.

    Attributes:
        cases: in the order of the first runs.
        variants: those that were run, in the order of `VARIANTS`.
        runs: by case and variant, ordered by seed.
        yardsticks: by case.
        scales: by case.
        horizon: seconds of the shortest runs, which comparisons over time go up to.
    """

    cases: tuple[Case, ...]
    variants: tuple[str, ...]
    runs: Mapping[tuple[Case, str], tuple[RunEntry, ...]]
    yardsticks: Mapping[Case, RunEntry]
    scales: Mapping[Case, Scale]
    horizon: float

    @classmethod
    def read(cls, runs_file: Path, yardstick_file: Path) -> EvaluationResults:
        """Read what `python -m benchmarks paper` and `yardstick` have written.

        Raises:
            ParameterError: there is no run, or a case has no yardstick.
        """
        return cls.of(read_lines(runs_file), read_lines(yardstick_file))

    @classmethod
    def of(cls, records: Sequence[RunEntry], yardsticks: Sequence[RunEntry]) -> EvaluationResults:
        """Group records, and scale each case by the best of its yardstick and its runs."""
        if not records:
            raise ParameterError(
                "runs", "none recorded", "run python -m benchmarks paper --output on the folder"
            )
        groups: defaultdict[tuple[Case, str], list[RunEntry]] = defaultdict(list)
        for record in records:
            groups[Case(**record["case"]), record["variant"]].append(record)
        cases = tuple(dict.fromkeys(case for case, _ in groups))
        measured = {Case(**entry["case"]): entry for entry in yardsticks}
        for case in cases:
            if case not in measured or measured[case]["random"] is None:
                raise ParameterError(
                    "yardstick", str(case), "has none: run python -m benchmarks yardstick"
                )
        names = {variant for _, variant in groups}
        runs = {
            key: tuple(sorted(group, key=lambda record: int(record["seed"])))
            for key, group in groups.items()
        }
        return cls(
            cases,
            tuple(name for name in VARIANTS if name in names),
            runs,
            {case: measured[case] for case in cases},
            {case: _scale_of(case, runs, measured[case]) for case in cases},
            min(float(record["time_limit"]) for record in records),
        )

    def of_variant(self, variant: str, case: Case) -> tuple[RunEntry, ...]:
        """Its runs on a case; none where it was not run."""
        return self.runs.get((case, variant), ())

    def cases_of(self, *variants: str) -> list[Case]:
        """Cases that every one of the variants was run on."""
        return [c for c in self.cases if all(self.of_variant(v, c) for v in variants)]

    def steps(self, record: RunEntry) -> list[tuple[float, float]]:
        """(seconds, relative objective) of a run's placements."""
        scale = self.scales[Case(**record["case"])]
        return [(s["time"], scale.relative(s["objective"])) for s in record["solutions"]]

    def best_run(self, case: Case) -> RunEntry | None:
        """The run that found the best placement of the case."""
        solved = [r for v in self.variants for r in self.of_variant(v, case) if r["solutions"]]
        return max(solved, key=lambda r: float(r["solutions"][-1]["objective"]), default=None)

    def failed(self) -> list[RunEntry]:
        """Runs without a placement."""
        return [r for group in self.runs.values() for r in group if not r["solutions"]]


def _scale_of(
    case: Case, runs: Mapping[tuple[Case, str], tuple[RunEntry, ...]], yardstick: RunEntry
) -> Scale:
    known = [] if yardstick["best"] is None else [float(yardstick["best"])]
    for (other, _), group in runs.items():
        if other == case:
            known += [float(r["solutions"][-1]["objective"]) for r in group if r["solutions"]]
    if not known:
        raise ParameterError("runs", str(case), "was solved by no run and no exhaustive search")
    return Scale(max(known), float(yardstick["random"]))
