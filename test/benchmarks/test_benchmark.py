"""The command line: cases that resume, progress, and what works without the drawing library."""

from benchmarks.__main__ import main
from benchmarks.json_lines import read_lines

ONE_CASE = ["--scene", "table", "--object", "small_crayons_box"]
ONE_CASE += ["--objective", "maximize_clearance"]


def test_cases_keep_every_solution_and_resume(tmp_path, capsys):
    command = ["cases", *ONE_CASE, "--enough", "2", "--output", str(tmp_path)]
    assert main([*command, "--seeds", "1"]) == 0
    (record,) = read_lines(tmp_path / "runs.jsonl")
    assert len(record["solutions"]) == record["enough"] == 2
    assert 0.0 < record["environment"] < record["preparation"] < record["solutions"][0]["time"]
    name = "table-small_crayons_box-maximize_clearance-complete-0-"
    kept = sorted(path.name for path in (tmp_path / "solutions").iterdir())
    assert kept == [f"{name}1.npz", f"{name}2.npz"]
    capsys.readouterr()
    assert main([*command, "--seeds", "2"]) == 0
    said = capsys.readouterr().out
    assert "1 of 2 runs are recorded" in said
    assert "[1/1, 0 s left]" in said
    assert "2 of 2 runs solved" in said
    assert [r["seed"] for r in read_lines(tmp_path / "runs.jsonl")] == [0, 1]


def test_cases_that_find_nothing_are_recorded_and_counted(tmp_path, capsys):
    command = ["cases", *ONE_CASE, "--seeds", "1", "--seconds", "1e-3", "--output", str(tmp_path)]
    assert main(command) == 1
    said = capsys.readouterr().out
    assert "FAILED: no sample was tried" in said
    assert "0 of 1 runs solved" in said
    assert main(command) == 1  # a failure that was recorded before counts again
    assert len(read_lines(tmp_path / "runs.jsonl")) == 1
