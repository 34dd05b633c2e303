"""The speed benchmark: its random subsets, percentiles and table, and the command on one case."""

from __future__ import annotations

import json

from benchmarks.__main__ import main
from benchmarks.cases import Case
from benchmarks.speed.rows import MADE_WITH
from benchmarks.speed.searches import measure_sampling

CASE = Case("table", "small_crayons_box", "maximize_clearance")
ONE_CASE = ["--scene", CASE.scene, "--object", CASE.object, "--objective", CASE.objective]


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
