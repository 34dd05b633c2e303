"""How time grows with V, cloud and clutter: settings, hand-worked exponents, and a run."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from helpers.scaling import record

from benchmarks.cases import Case
from benchmarks.record import Trial
from benchmarks.scaling.cluttered_table import MOST_THINGS, cluttered_table
from benchmarks.scaling.growth import growths
from benchmarks.scaling.report import draw_scaling, scaling_table
from benchmarks.scaling.runs import FACTORS, ScalingJob, run_scaling, scaled_volume, scaling_jobs
from benchmarks.variants import VARIANTS
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.scenes.scenes import scene_by_name


def test_volumes_double_about_one_middle():
    whole = scene_by_name("table").volume
    sizes = []
    for factor in FACTORS:
        part = scaled_volume(whole, factor)
        np.testing.assert_allclose(part.lower + part.upper, whole.lower + whole.upper)
        assert (part.upper - part.lower)[2] == pytest.approx((whole.upper - whole.lower)[2])
        sizes.append(np.prod(part.upper - part.lower))
    np.testing.assert_allclose(np.divide(sizes[1:], sizes[:-1]), 2.0)
    np.testing.assert_allclose(part.upper, whole.upper)


def test_more_clutter_is_added_to_what_stands_there_and_overlaps_nothing():
    few, many = cluttered_table(4).parts, cluttered_table(MOST_THINGS).parts
    assert len(many) == MOST_THINGS + 1
    for a, b in zip(few, many, strict=False):
        np.testing.assert_array_equal(a.vertices, b.vertices)
    volume = scene_by_name("table").volume
    for part in many[1:]:
        assert (part.vertices[:, :2] >= volume.lower[:2]).all()
        assert (part.vertices[:, :2] <= volume.upper[:2]).all()
        assert part.vertices[:, 2].min() == 0.0
    for a, b in itertools.combinations(many[1:], 2):
        assert a.depth(b.vertices).max() < 0.0
    with pytest.raises(ParameterError, match="things"):
        cluttered_table(MOST_THINGS + 1)


def test_exponents_by_hand():
    """Nine tenths of the way from 0.1 to 0.5 is 0.46, which 0.47 passes and 0.3 does not."""
    records = [
        record(axis, factor, seed, [(0.5, 0.3), (seconds, 0.47), (8.5, 0.5)])
        for seed in range(3)
        for axis, times in (("volume", (1, 2, 4, 8)), ("clutter", (1, 1, 2, 2)))
        for factor, seconds in zip(FACTORS, times, strict=True)
    ]
    linear, root = growths(records)
    np.testing.assert_array_equal(linear.medians, [1, 2, 4, 8])
    np.testing.assert_array_equal(linear.sizes, [100, 200, 400, 800])
    assert linear.exponent == pytest.approx(1.0)
    assert linear.interval == pytest.approx((1.0, 1.0))
    assert root.exponent == pytest.approx(0.4)  # (-1.5·0 - 0.5·0 + 0.5·1 + 1.5·1) / 5
    rows = scaling_table([linear, root]).rows
    assert [row[-1] for row in rows] == ["no", "yes"]
    assert draw_scaling([linear, root]).startswith(b"\x89PNG")
    once = growths([r for r in records if r["seed"] == 0])
    assert [row[-1] for row in scaling_table(once).rows] == ["too few runs"] * 2


def test_runs_that_never_get_there_count_as_endless():
    ending = [record("cloud", 1, seed, [(1.0, 0.5)]) for seed in range(3)]
    lost = [record("cloud", 2, 0, [(1.0, 0.5)]), record("cloud", 2, 1, [(1.0, 0.2)])]
    lost.append(record("cloud", 2, 2, []))
    (growth,) = growths([*ending, *lost])
    np.testing.assert_array_equal(growth.medians, [1.0, np.inf])
    assert growth.exponent == np.inf
    assert growth.interval[1] == np.inf
    row = scaling_table([growth]).rows[0]
    assert row[3:] == ("1.00 → never", row[4], "no")
    assert draw_scaling([growth]).startswith(b"\x89PNG")
    assert growths(ending) == []


def test_a_run_that_finds_nothing_is_recorded_with_its_setting():
    case = Case("table", "small_crayons_box", "minimize_clearance")
    job = ScalingJob("volume", 1, Trial(case, next(iter(VARIANTS)), 3, 1e-3))
    found = run_scaling(job)
    assert (found["axis"], found["factor"], found["seed"]) == ("volume", 1, 3)
    assert found["solutions"] == []
    assert "no sample was tried" in found["failure"]
    whole = scene_by_name("table").volume
    assert found["size"] == pytest.approx(np.prod(whole.upper - whole.lower) / 8)
    assert -0.5 < found["random"] < 0.0


def test_jobs_cover_every_setting():
    jobs = scaling_jobs(2, 5.0)
    assert len({job.key for job in jobs}) == len(jobs) == 2 * 3 * 4 * 2
    assert {job.axis for job in scaling_jobs(1, 5.0, ("cloud",))} == {"cloud"}
    with pytest.raises(ParameterError, match="seconds"):
        scaling_jobs(1, 0.0)
