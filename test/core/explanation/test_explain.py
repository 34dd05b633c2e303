"""What is said of searches that fail for one reason, each made to fail for it."""

import re
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from helpers.problems import problem_of
from helpers.tilts import tilted_problem

from benchmarks.cases import Case
from placement_planner_ros.core.explanation.constraint_table import TABLE as ROWS
from placement_planner_ros.core.explanation.constraint_table import shares_in_words
from placement_planner_ros.core.explanation.explain import explain_search
from placement_planner_ros.core.explanation.explanation import SENSOR, Explanation, Remedy, quoted
from placement_planner_ros.core.explanation.surfaces import regions_in_words, why_no_region
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.motion.birrt import GoalSetRRT
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.scene.near_points import NearPoints
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.search.sampler import SampleCount
from placement_planner_ros.core.types import TargetVolume, Verdict, steepness
from placement_planner_ros.ros import node_words
from placement_planner_ros.ros.parameters.table import arm_specs, arms_spec, fixed_specs

TABLE = Case("table", "small_crayons_box", "maximize_clearance")
NAMES = {
    spec.name
    for spec in (
        *fixed_specs(),
        arms_spec(["left", "right"]),
        *arm_specs("left", yumi=True),
        *arm_specs("right", yumi=True),
    )
} | {"sensor_poses.<frame>"}


@pytest.fixture(scope="module")
def table():
    return problem_of(TABLE)


def in_node_words(told):
    """What the remedies are about, by the node's names."""
    return [node_words.in_node_words(quoted(remedy.parameter)) for remedy in told.remedies]


def planned(table, samples=600, **settings):
    problem, objective = table
    chosen = replace(PlannerSettings(), **settings)
    planner = PlacementPlanner(problem, objective, chosen, np.random.default_rng(0))
    assert list(planner.run(lambda: planner.statistics.samples >= samples)) == []
    return planner


@pytest.mark.parametrize(
    ("verdict", "remedies"),
    [
        (Verdict.ARM_COLLIDING, ["left.grasps, right.grasps", "target_volume"]),
        (
            Verdict.NO_RELEASE,
            [
                "left.gripper_open, right.gripper_open",
                "left.grasps, right.grasps",
                "require_retreat",
            ],
        ),
        (Verdict.NO_APPROACH, ["target_volume", "left.grasps, right.grasps"]),
        (Verdict.NO_RETREAT, ["left.grasps, right.grasps", "require_retreat"]),
    ],
    ids=str,
)
def test_what_refuses_all_is_the_cause_and_its_remedies_exist(table, verdict, remedies):
    free = mock.patch.object(Holding, "first_verdicts", lambda _, T, __: np.full(len(T), 10))
    with free, mock.patch.object(Holding, "placing_motion", return_value=verdict):
        planner = planned(table)
    told = planner.explain()
    assert ROWS[verdict].did in told.cause
    refused = planner.statistics.rejected[verdict.name.lower()]
    assert f"{refused:,} of " in told.cause
    named = in_node_words(told)
    assert [name for name in named if name in remedies] == remedies
    assert {name for names in named for name in names.split(", ")} <= NAMES


def test_of_several_proofs_that_nothing_is_left_each_is_told_with_its_remedy(table):
    planner = PlacementPlanner(*table, PlannerSettings(), np.random.default_rng(0))

    def told(*rulings):
        return explain_search(planner._search, planner.statistics, {*rulings})

    reach, support = told(Ruling.OUT_OF_REACH), told(Ruling.UNSUPPORTED)
    both = told(*(ruled := (Ruling.UNSUPPORTED, Ruling.OUT_OF_REACH)))
    assert "out of reach of every arm" in reach.cause
    assert "support" not in reach.short
    assert "without support" in support.cause
    assert "reach" not in support.short
    assert both.cause.index("out of reach of every arm") < both.cause.index(", or without support")
    parameters = [{r.parameter for r in each.remedies} for each in (both, reach, support)]
    assert parameters[0] == parameters[1] | parameters[2]
    # what most samples lacked comes first
    for n, most, verdict in ((9, reach, Verdict.NO_IK), (10, support, Verdict.OUTSIDE_VOLUME)):
        planner.statistics.count.add(np.full(n, verdict))
        assert told(*ruled).remedies[0] == most.remedies[0]
    for each in (reach, support):
        assert {name for names in in_node_words(each) for name in names.split(", ")} <= NAMES


def test_where_no_motion_is_found_what_is_on_the_way_is_told(table):
    with mock.patch.object(GoalSetRRT, "solve", return_value=None):
        told = planned(table).explain()
    assert re.match(r"\d+ placements were found, but no motion", told.cause)
    assert told.remedies[0].parameter == "time_limit"


def test_explaining_changes_nothing_in_the_search(table):
    """Neither its random numbers nor what it finds."""
    problem, objective = table
    refuse, calls, place = [], [], Holding.placing_motion

    def at_first(*arguments):
        refuse.append(None)
        return Verdict.NO_RETREAT if len(refuse) < 150 else place(*arguments)

    found = []
    for asked in (False, True):
        refuse.clear()
        planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(0))

        def should_stop(planner=planner, asked=asked):
            calls.append(None)
            if asked and len(calls) in (20, 50, 100, 200, 400):
                planner.explain()
            return planner.statistics.solutions > 0 or planner.statistics.samples > 5000

        with mock.patch.object(Holding, "placing_motion", at_first):
            found.append([p.trajectory.positions for p in planner.run(should_stop)])
        assert planner.statistics.samples > 100
    assert len(found[0]) == len(found[1]) > 0
    assert all(map(np.array_equal, *found))


def test_counts_are_told_as_shares_the_most_frequent_first():
    count, numbers = SampleCount(), [40, 120, 40]
    verdicts = np.repeat([Verdict.NO_IK, Verdict.UNSTABLE, Verdict.FEASIBLE], numbers)
    count.add(verdicts)
    told = shares_in_words(count.verdicts)
    assert told.startswith("of 200 samples 60% left the object without support, 20% ")
    assert "20% were placements" in told


def test_an_explanation_in_one_line_and_in_several():
    remedies = Remedy("umbrella", "open it"), Remedy("time", "wait")
    told = Explanation("it rains", remedies, ("wet",))
    assert told.short == "it rains; try `umbrella`: open it; or `time`: wait"
    assert str(told).splitlines()[1:] == ["try `umbrella`: open it", "try `time`: wait", "wet"]
    assert str(Explanation("it rains")) == Explanation("it rains").short == "it rains"


def test_of_no_points_it_is_told_whether_any_were_the_robots():
    bounds = np.zeros(3), np.ones(3)
    empty = Environment.from_points(np.zeros((0, 3)), TargetVolume(*bounds), bounds=bounds)
    assert why_no_region(empty).cause.endswith("is empty, or none of its points is finite")
    told = why_no_region(empty.with_near(NearPoints(left_out=7)))
    assert "7 points" in told.cause
    assert [remedy.parameter for remedy in told.remedies] == ["environment", "own points"]


def in_cells(size, *surfaces, floor=0.0):
    """A volume with level or steep (x, y, width, depth, rise) at z = 0, points 2 mm apart."""
    points = [np.zeros((0, 3))]
    for x, y, width, depth, rise in surfaces:
        along, across = np.mgrid[0.0:width:0.002, 0.0:depth:0.002].reshape(2, -1)
        points.append(np.stack([x + along, y + across, rise * along], axis=1))
    volume = TargetVolume([0.0, 0.0, floor], [0.5, 0.5, 0.3])
    return Environment.from_points(np.concatenate(points), volume, GridSettings(cell_size=size))


def test_cells_that_are_too_large_or_too_small_are_named_first():
    """With large ones the level table is no region, and their boxes end above V."""
    table = (0.0, 0.0, 0.5, 0.5, 0.0)
    told = why_no_region(in_cells(0.1, table, floor=-0.03))
    assert "without holes" in told.cause
    assert str(told.remedies[0]) == "`cell_size`: lower it: 0.1 m is set, 0.01 m is usual"
    told = why_no_region(in_cells(0.002, (0.0, 0.0, 0.008, 0.008, 0.0)))
    assert str(told.remedies[0]) == "`cell_size`: raise it: 0.002 m is set, 0.01 m is usual"


def test_a_small_slope_beside_a_large_level_surface_is_not_blamed():
    ramp = (0.4, 0.2, 0.1, 0.1, 0.3)
    for level, blamed in ((0.35, False), (0.05, True)):
        seen = in_cells(0.01, (0.0, 0.0, level, level, 0.0), ramp, floor=-0.05)
        assert seen.steep, "the ramp was found"
        assert any("slopes by" in words for words in regions_in_words(seen)) == blamed


def test_heights_that_scatter_are_told_as_a_range_without_a_height_for_the_volume():
    wall = np.stack([*np.mgrid[0.1:0.4:0.004, 0.5:0.9:0.004].reshape(2, -1)[[0, 0, 1]]], axis=1)
    told = why_no_region(Environment.from_points(wall, TargetVolume([0, 0, 0], [0.5, 0.5, 0.3])))
    assert "above it, between z = 0.59" in told.cause.replace("0.60", "0.59")
    assert [remedy.parameter for remedy in told.remedies] == [SENSOR]


def test_a_table_that_is_too_steep_is_named_with_its_angle_and_the_remedy_helps():
    """Nothing stands on it until max_slope allows what is named."""

    def tilted(limit):
        return tilted_problem(TABLE, 3.0, 0.8, np.random.default_rng(0), max_slope=limit)

    told = planned(tilted(0.02)).explain()
    assert "slopes by 3.0 degrees" in str(told)
    assert "`max_slope` allows 1.1" in str(told)
    (words,) = (each.words for each in told.remedies if each.parameter == "max_slope")
    allowed = float(re.search(r"raise it to ([\d.]+)", words).group(1))
    assert np.radians(3.0) - 0.001 < allowed < np.radians(3.0) + 0.002
    planner = PlacementPlanner(*tilted(allowed), PlannerSettings(), np.random.default_rng(0))
    found = next(planner.run(lambda: planner.statistics.samples >= 5000))
    assert steepness(found.goal.slope) == pytest.approx(np.radians(3.0), abs=0.002)
