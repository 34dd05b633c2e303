"""The evaluation: its statistics by hand-worked numbers, runs that resume, and the report."""

from __future__ import annotations

import itertools
import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from helpers.problems import problem_of

from benchmarks.__main__ import main
from benchmarks.baselines.rrt_connect import STOCK_SETTINGS, BaselinePlanner
from benchmarks.cases import Case
from benchmarks.evaluation.comparisons import compare
from benchmarks.evaluation.paper import PRESETS, preset_trials
from benchmarks.evaluation.relative import Scale, area_under_curve, values_at
from benchmarks.evaluation.resampling import mean_interval
from benchmarks.evaluation.results import EvaluationResults
from benchmarks.json_lines import append_line, read_lines
from benchmarks.record import RecordedRun, RecordedSolution, Trial, trial_entry
from benchmarks.yardstick.exhaustive_search import YardstickJob, measure_yardstick
from placement_planner_ros.core.errors import ParameterError

TABLE = Case("table", "wine_glass", "maximize_clearance")
CABINET = Case("cabinet_low_clutter", "toy_table", "minimize_clearance")
STEPS = [(1.0, 0.5), (3.0, 0.9)]


def recorded(case, variant, seed, objectives, limit=4.0):
    """A run with one placement per second, from 1 s on."""
    run = RecordedRun(seed, limit, preparation=0.5, elapsed=limit)
    run.samples, run.rejected = 70, {"unstable": 42, "not_better": 14}
    for second, objective in enumerate(objectives, start=1):
        pose = [[1.0, 0.0, 0.0, 0.4], [0.0, 1.0, 0.0, 0.1], [0.0, 0.0, 1.0, 0.1]]
        solution = RecordedSolution(float(second), objective, "left", 0, 0, 7, pose, [0.0] * 7)
        run.solutions.append(solution)
    run.failure = "" if objectives else "nothing was found"
    return trial_entry(Trial(case, variant, seed, limit), run)


def yardstick(case, best, random):
    return {"case": asdict(case), "best": best, "random": random, "complete": True}


def some_results():
    """Reference and two others; the second case is worth more by its run than by its yardstick."""
    runs = [
        recorded(TABLE, "optimistic+lo", 0, [0.2, 0.4]),
        recorded(TABLE, "optimistic+lo", 1, [0.4]),
        recorded(TABLE, "uniform+lo", 0, [0.2]),
        recorded(TABLE, "uniform+lo", 1, []),
        recorded(TABLE, "baseline", 0, [0.1, 0.3]),
        recorded(CABINET, "optimistic+lo", 0, [-0.3]),
        recorded(CABINET, "uniform+lo", 0, [-0.4]),
    ]
    return EvaluationResults.of(runs, [yardstick(TABLE, 0.4, 0.0), yardstick(CABINET, -0.35, -0.5)])


def test_the_relative_objective_is_1_at_the_best_0_at_random_and_clipped_below_only():
    scale = Scale(best=-0.1, random=-0.3)
    assert scale.relative(-0.1) == pytest.approx(1.0)
    assert scale.relative(-0.2) == pytest.approx(0.5)
    assert scale.relative(-0.9) == 0.0
    assert scale.relative(0.0) == pytest.approx(1.5)
    with pytest.raises(ParameterError, match="random placement"):
        Scale(best=0.1, random=0.1)


def test_the_area_under_the_curve_is_the_mean_over_time():
    assert area_under_curve(STEPS, 4.0) == pytest.approx((2 * 0.5 + 1 * 0.9) / 4)
    assert area_under_curve(STEPS, 2.0) == pytest.approx(0.5 / 2)
    assert area_under_curve(STEPS, 1.0) == 0.0
    assert area_under_curve([], 4.0) == 0.0
    fine = np.linspace(0, 4, 40_001)[:-1]
    assert area_under_curve(STEPS, 4.0) == pytest.approx(values_at(fine, STEPS).mean(), abs=1e-3)


def test_bootstrap_counts_cases_alike_and_draws_within_them():
    """The mean of the groups' means, (1 + 5) / 2; no draw mixes the groups."""
    found = mean_interval([[1.0, 1.0, 1.0, 1.0], [5.0, 5.0]], np.random.default_rng(0))
    assert (found.mean, found.low, found.high) == (3.0, 3.0, 3.0)
    curves = mean_interval([[[0.0, 2.0]], [[2.0, 4.0]]], np.random.default_rng(0))
    np.testing.assert_array_equal(curves.mean, [1.0, 3.0])


def test_differences_are_paired_by_seed_and_pooled_over_cases():
    """Over 4 s, relative: table 0.5 then 1 from 1 s and 2 s: 0.625; 1 from 1 s: 0.75.

    Uniform has 0.5 from 1 s: 0.375, and nothing. Differences 0.25 and 0.75. In the cabinet 1 and
    0.5 from 1 s: 0.75 - 0.375.
    """
    comparison = compare(some_results(), "uniform+lo")
    assert comparison.by_case == pytest.approx({TABLE: 0.5, CABINET: 0.375})
    assert float(comparison.pooled.mean) == pytest.approx((0.5 + 0.375) / 2)
    assert float(comparison.pooled.low) == pytest.approx((0.25 + 0.375) / 2)
    assert compare(some_results(), "optimistic") is None


def test_a_torn_last_line_is_cut_off_and_any_other_damage_told(tmp_path):
    path = tmp_path / "lines.jsonl"
    append_line(path, {"a": 1})
    with path.open("a") as file:
        file.write('{"a": 2')
    assert read_lines(path) == [{"a": 1}]
    append_line(path, {"a": 3})
    assert read_lines(path) == [{"a": 1}, {"a": 3}]
    path.write_text('{"a"\n{"a": 1}\n')
    with pytest.raises(json.JSONDecodeError):
        read_lines(path)
    assert read_lines(tmp_path / "none.jsonl") == []


def test_the_smoke_preset_runs_every_variant_and_is_reported(tmp_path, capsys, monkeypatch):
    short = replace(PRESETS["smoke"], seconds=0.5, baseline_seconds=1.0)
    monkeypatch.setitem(PRESETS, "smoke", short)
    assert main(["paper", "--preset", "smoke", "--output", str(tmp_path)]) == 0
    records = read_lines(tmp_path / "runs.jsonl")
    assert {r["key"] for r in records} == {t.key for t in preset_trials(PRESETS["smoke"])}
    for record in records:
        assert bool(record["solutions"]) != bool(record["failure"])
        assert "Traceback" not in record["failure"]
        objectives = [s["objective"] for s in record["solutions"]]
        assert all(b > a for a, b in itertools.pairwise(objectives))
        assert all(s["time"] > record["preparation"] > 0.0 for s in record["solutions"])
        assert sum(record["rejected"].values()) + record["goals"] >= record["samples"]
        assert record["versions"]["numba"]
        assert record["machine"]["threads"] >= 1
    for case, best, random in ((TABLE, 0.45, 0.0), (CABINET, -0.03, -0.2)):
        append_line(tmp_path / "yardstick.jsonl", yardstick(case, best, random))
    assert main(["report", str(tmp_path)]) == 0
    assert "summary.md" in capsys.readouterr().out


def test_the_baseline_reaches_its_placements_with_rrt_connect():
    problem, objective = problem_of(TABLE)
    planner = BaselinePlanner(problem, objective, STOCK_SETTINGS, np.random.default_rng(0))
    placements = list(planner.run(lambda: planner.statistics.solutions >= 2))
    assert len(placements) == 2
    assert placements[1].objective > placements[0].objective
    for placement in placements:
        arm = next(a for a in problem.arms if a.name == placement.goal.arm)
        start = placement.trajectory.positions[0]
        np.testing.assert_allclose(start, problem.q_start[arm.q_index], atol=1e-9)
        np.testing.assert_allclose(placement.trajectory.positions[-1], placement.goal.q, atol=1e-6)


def test_the_report_holds_figures_and_tables(tmp_path):
    from benchmarks.evaluation.report import write_report

    written = write_report(some_results(), tmp_path)
    assert all(path.stat().st_size > 0 for path in written)
    summary = (tmp_path / "summary.md").read_text()
    assert "nothing was found" in summary
    assert "| -0.3500 (beaten) | -0.3000 |" in summary
    assert "| +0.4000 | +0.4000 |" in summary
    assert (
        "| optimistic+lo minus uniform+lo | +0.438 [+0.313, +0.562] | 2 of 2 | +0.375," in summary
    )
    assert "| optimistic+lo | 3 of 3 | 1.00 s | 1.00 s | 1.00 s |" in summary
    assert "| uniform+lo | 2 of 3 | 1.00 s | never | never |" in summary
    for name in ("overall", "by_scene"):
        assert f"figures/{name}.png" in summary
        assert (tmp_path / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_a_report_without_yardstick_says_what_to_run(tmp_path, capsys):
    append_line(tmp_path / "runs.jsonl", recorded(TABLE, "optimistic+lo", 0, [0.1]))
    assert main(["report", str(tmp_path)]) == 2
    assert "python -m benchmarks yardstick" in capsys.readouterr().err


def test_the_yardstick_is_better_than_random_and_says_what_may_be_left(monkeypatch):
    monkeypatch.setattr("benchmarks.yardstick.exhaustive_search._STEP_M", 0.016)  # in less time
    case = Case("table", "wine_glass", "minimize_clearance")
    (record,) = measure_yardstick(YardstickJob(case, seconds=20.0, random_placements=15))
    assert record["random_placements"] == 15
    # after some 5 s; the best is -0.0746 without the finer grids
    assert record["best"] > -0.0742 > record["random"]
    assert record["most"] >= record["best"]
    enough = record["best"] + 0.02 * (record["best"] - record["random"])
    assert record["complete"] == (record["most"] <= enough)
