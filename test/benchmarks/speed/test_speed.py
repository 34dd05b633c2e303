"""The speed benchmark: its random subsets, percentiles and table, and the command on one case."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from benchmarks.__main__ import main
from benchmarks.cases import Case
from benchmarks.speed.recorder import Recording, RecordingSettings, record_queries
from benchmarks.speed.rows import (
    MADE_WITH,
    SpeedLine,
    first_seconds,
    lines_of,
    slope_per_hour,
)
from benchmarks.speed.searches import measure_sampling

SHORT = RecordingSettings(runs=1, samples=150, seconds=600.0, states=60, edges=40)
CASE = Case("table", "small_crayons_box", "maximize_clearance")
ONE_CASE = ["--scene", CASE.scene, "--object", CASE.object, "--objective", CASE.objective]


def line(value, target, higher):
    bound = ">=" if higher else "<="
    return SpeedLine("what", value, target, f"{value:g}", f"{bound} {target:g}", "detail")


@pytest.mark.parametrize(
    ("value", "target", "higher", "margin"),
    [
        (300.0, 100.0, True, 3.0),
        (50.0, 100.0, True, 0.5),
        (0.1, 0.2, False, 2.0),
        (0.4, 0.2, False, 0.5),
        (0.0, 0.0, False, math.inf),
        (1.0, 0.0, False, 0.0),
        (math.nan, 5.0, True, 0.0),
    ],
)
def test_how_a_figure_stands_to_its_target(value, target, higher, margin):
    assert line(value, target, higher).margin == pytest.approx(margin)
    assert line(value, target, higher).met == (margin >= 1.0)


def first(case, seed, seconds, *, solved=True):
    return {
        "row": "first",
        "case": case,
        "seed": seed,
        "limit": 10.0,
        "solved": solved,
        "environment_seconds": 0.5,
        "cpu_seconds": seconds,
        "planner_seconds": 0.25 * seconds,
        "search_seconds": 0.75 * seconds,
    }


def test_a_run_without_a_placement_counts_at_its_limit():
    assert first_seconds(first("a", 0, 0.2), environment=False) == pytest.approx(0.2)
    assert first_seconds(first("a", 0, 0.2), environment=True) == pytest.approx(0.7)
    assert first_seconds(first("a", 0, 0.1, solved=False), environment=False) == 10.0
    assert first_seconds(first("a", 0, 11.0, solved=False), environment=False) == 11.0


def test_rates_and_ratios_are_medians_over_cases():
    entries = [
        {"row": "configurations", "case": "a", "queries": 100, "free": 30, "undecided": 1}
        | {"seconds": seconds, "free_seconds": 6e-5, "colliding_seconds": 7e-5}
        for seconds in (1e-4, 2e-4, 1e-3)
    ]
    (rate,) = lines_of(entries)
    assert rate.value == pytest.approx(5e5)
    assert rate.met
    assert "30.0% free" in rate.detail
    assert "1.0% left undecided" in rate.detail
    assert "2.0 µs for a free one, 1.0 µs for a colliding one" in rate.detail


def test_the_slope_of_memory_leaves_out_the_beginning():
    seconds = np.arange(0.0, 100.0, 1.0)
    values = 500.0 + 0.01 * seconds
    values[:15] = 100.0
    assert slope_per_hour(seconds, values) == pytest.approx(36.0)
    assert math.isnan(slope_per_hour([0.0, 1.0], [1.0, 2.0]))


@pytest.fixture(scope="module")
def recording() -> Recording:
    return record_queries(CASE, 0, SHORT)


def test_recorded_queries_are_those_of_the_run(recording):
    assert recording.seen["states"] > 0
    assert sum(len(queries.states) for queries in recording.held) <= 60
    assert sum(len(queries.edges) for queries in recording.held) <= 40
    for queries in recording.held:
        arm = queries.holding.arm
        for rows in (queries.states, queries.edges.reshape(-1, arm.dof)):
            assert (rows >= arm.lower - 1e-9).all()
            assert (rows <= arm.upper + 1e-9).all()
        assert len(queries.contact) == len(queries.states)
    starts = np.vstack([queries.edges[:, 0] for queries in recording.held])
    assert len(np.unique(starts.round(9), axis=0)) > 1


def test_the_sampling_rate_counts_every_sample_of_the_run():
    entry = measure_sampling(CASE, 0, 0.3)
    assert entry["samples"] == entry["goals"] + sum(entry["rejected"].values()) > 0
    assert 0.0 < entry["seconds"] < entry["run_seconds"]


def test_the_command_on_one_case(tmp_path, capsys):
    small = ["--runs", "1", "--samples", "150"]
    (tmp_path / "raw.jsonl").write_text(
        json.dumps({"row": MADE_WITH, "rows": ["samples", "edges"]})
        + "\n"
        + json.dumps({"row": "samples", "case": "old", "samples": 10, "seconds": 1.0})
        + "\n"
        + json.dumps({"row": "edges", "job": "old", "error": "of an earlier run"})
        + "\n"
    )
    only = ["--rows", "configurations", "edges"]
    assert main(["speed", *only, *ONE_CASE, *small, "--output", str(tmp_path)]) == 0
    entries = [json.loads(text) for text in (tmp_path / "raw.jsonl").read_text().splitlines()]
    rows = {entry["row"] for entry in entries}
    measured = {"configurations", "edges"}
    assert rows == {"samples", MADE_WITH} | measured
    assert [set(e["rows"]) for e in entries if e["row"] == MADE_WITH] == [{"samples"}, measured]
    assert not any("error" in entry for entry in entries)
    assert sum(entry["refuted"] for entry in entries if entry["row"] == "edges") == 0
    table = (tmp_path / "speed.md").read_text()
    assert "configurations per second" in table
    assert "goal samples tried per second" in table
    assert "[1/1, 0 s left]" in capsys.readouterr().out


def test_a_page_is_filled_between_its_marks(tmp_path, capsys):
    page, raw = tmp_path / "page.md", tmp_path / "raw.jsonl"
    report = ["speed", "--report-only", "--output", str(tmp_path), "--page", str(page)]
    page.write_text("no place for a table")
    assert main(report) == 2
    assert "page.md" in capsys.readouterr().err
    page.write_text("before\n<!-- figures -->\nold\n<!-- end of figures -->\nafter\n")
    assert main(report) == 2
    assert "holds no figures yet" in capsys.readouterr().err
    raw.write_text(json.dumps({"row": "samples", "case": "a", "samples": 9, "seconds": 1}) + "\n")
    assert main(report) == 0
    text = page.read_text()
    assert text.startswith("before\n<!-- figures -->\n\n| what |")
    assert text.endswith("<!-- end of figures -->\nafter\n")
    assert "old" not in text
    once = text
    assert main(report) == 0
    assert page.read_text() == once
