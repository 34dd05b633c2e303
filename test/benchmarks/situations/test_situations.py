"""Situations: their truth holds by geometry, and the planner says it."""

import json

import coal
import numpy as np
import pytest
from checker import Task, Tolerances, check_stance
from checker.shapes import convex

from benchmarks.__main__ import main
from benchmarks.household import object_by_name
from benchmarks.json_lines import append_line, read_lines
from benchmarks.situations.catalogue import all_situations
from benchmarks.situations.observing import observe
from benchmarks.situations.report import situations_report
from benchmarks.situations.runs import RUNS_FILE, outcome

DRAWN = all_situations(np.random.default_rng(5))
STANDING = [name for name, situation in DRAWN.items() if situation.pose_exists]
MARGIN, FLAT = 0.003, 1e-4


def moved(points, T):
    return points @ T.rotation.T + T.translation


def gap(one, other):
    """Distance of two hulls, negative where they overlap."""
    at = coal.Transform3s.Identity()
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    return coal.distance(convex(one), at, convex(other), at, request, coal.DistanceResult())


def test_a_seed_draws_the_same_and_another_one_others():
    again, other = (all_situations(np.random.default_rng(seed)) for seed in (5, 6))
    assert list(again) == list(other) == list(DRAWN)
    for name, situation in DRAWN.items():
        for kept, part in zip(again[name].scene.parts, situation.scene.parts, strict=True):
            np.testing.assert_array_equal(kept.vertices, part.vertices)
        assert again[name].why == situation.why
        corners = [s.scene.volume.boxes for s in (situation, other[name])]
        assert not np.array_equal(*corners)


@pytest.mark.parametrize("name", STANDING)
def test_witnesses_stand_and_keep_the_margin(name):
    situation = DRAWN[name]
    thing, T = object_by_name(situation.thing), situation.witness
    task = Task.of(situation.scene, thing, support=situation.support)
    said = check_stance(task, T.homogeneous, Tolerances())
    assert said == []
    parts = [moved(part.vertices, T) for part in thing.parts]
    lowest = min(part[:, 2].min() for part in parts)
    for solid in situation.scene.parts:
        near = min(gap(part, solid.vertices) for part in parts)
        assert near > -FLAT
        if solid.vertices[:, 2].max() > lowest + 2 * FLAT and solid.name != "table":
            assert near >= MARGIN  # it does not carry


def test_one_camera_sees_what_it_is_said_to_see():
    screened = DRAWN["behind_screen"]
    assert screened.possible("complete")
    assert not screened.possible("camera")
    low, high = screened.scene.volume.lower, screened.scene.volume.upper
    for cloud, there in (("complete", True), ("camera", False)):
        points = observe(screened, cloud, np.random.default_rng(0)).points
        inside = ((points > low) & (points < high)).all(axis=1)
        # a flying pixel may be anywhere
        assert (inside.sum() > 500) == there


@pytest.mark.parametrize(
    ("name", "cloud"),
    [
        ("tilted_3_about_both", "complete"),
        ("too_steep", "complete"),
        ("mug_between_walls", "camera"),
        ("slot_too_narrow", "camera"),
    ],
)
def test_the_planner_says_what_is_true(name, cloud, tmp_path, capsys):
    # more than enough where there is something to find, also on a machine that has its hands full
    seconds = "60" if DRAWN[name].possible(cloud) else "3"
    options = ["--situation", name, "--cloud", cloud, "--output", str(tmp_path)]
    options += ["--seconds", seconds]
    assert main(["situations", "--first-seed", "5", *options]) == 0
    (entry,) = read_lines(tmp_path / RUNS_FILE)
    assert outcome(entry) == "right"
    assert entry["possible"] == DRAWN[name].possible(cloud)
    assert len(list((tmp_path / "solutions").glob("*.npz"))) == len(entry["solutions"])
    assert main(["situations", "--first-seed", "5", *options]) == 0
    assert "1 of 1 runs are recorded" in capsys.readouterr().out
    assert len(read_lines(tmp_path / RUNS_FILE)) == 1


def entry_of(**changes):
    made = {
        "name": "a_bin", "group": "bins", "thing": "mug", "cloud": "complete", "seed": 0,
        "time_limit": 5.0, "support": "vertices", "why": "narrow", "possible": False,
        "pose_exists": False, "solutions": [], "exhausted": True, "failure": "no room",
        "versions": {"commit": "abc"},
    }  # fmt: skip
    return made | changes


def test_the_table_tells_what_is_wrong(tmp_path, capsys):
    wrong = entry_of(solutions=[{"time": 1.0}], seed=1, exhausted=False, failure="")
    entries = [entry_of(), wrong, entry_of(cloud="camera", possible=True, why="narrow; but seen")]
    fell = {"run": "a_bin-complete-1", "number": 1, "refused": ["collision: x"], "stays": False,
            "moved": 0.02, "tilted": 9.0}  # fmt: skip
    text = situations_report(entries, [fell])
    assert "| complete cloud | 2 | 1 (50.0 %) | 0 | 1 | 0 | 1 of 2 |" in text
    assert "`a_bin-complete-1`: placed though impossible" in text
    assert "collision: x; moves 20.0 mm, tilts 9.0°" in text
    assert "proven, **placed**" in text
    assert "**proven** (possible for it; but seen)" in text
    for entry in entries:
        append_line(tmp_path / RUNS_FILE, entry)
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- figures -->\nold\n<!-- end of figures -->\nafter\n")
    given = ["--report-only", "--output", str(tmp_path), "--page", str(page)]
    assert main(["situations", *given]) == 1  # something was placed that cannot be
    assert "proven, **placed**" in page.read_text()
    assert "old" not in page.read_text()
    assert json.loads((tmp_path / RUNS_FILE).read_text().splitlines()[0])["name"] == "a_bin"
    capsys.readouterr()
