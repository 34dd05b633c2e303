"""Placements on racks, bridges, pedestals and posts: the checker, the physics, and what is said."""

import functools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from checker import Solution, check_stance
from helpers.footholds import Block, cloud, pedestal, problem_on, rack, turned
from helpers.tasks import yumi_checker, yumi_task

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.problem import Problem, workspace
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import TargetVolume, Verdict
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.yumi import load_yumi, start_configuration, yumi_arm

VOLUME = TargetVolume([0.25, -0.25, -0.03], [0.6, 0.25, 0.25])
POLYGON = PlannerSettings(support="polygon")
FLOOR = Block("floor", (-0.2, 1.2), (-0.8, 0.8), z=-0.2)
TILTED = (0.0, np.tan(np.radians(4.0)))
SCENES = {
    "bridge": [Block("bridge", (0.2, 0.7), (-0.025, 0.025))],
    "wide bridge": [Block("bridge", (0.2, 0.7), (-0.04, 0.04))],
    "pedestal": [pedestal(0.06, 0.42, 0.05)],
    "rack": rack(0.045, 0.09),
}
RUNS = [
    ("bridge", "large_crayons_box", (0.0, 0.0)),
    ("pedestal", "wine_glass", (0.0, 0.0)),
    ("rack", "toy_table", (0.0, 0.0)),
    ("wide bridge", "large_crayons_box", TILTED),
]


def aside(T):
    """Larger, the farther towards y an object is: over the edge, if it may."""
    return float(T.translation[1])


@functools.cache
def problem_of(scene, name, slope):
    robot, held = load_yumi(), object_by_name(name)
    q = robot.configuration(start_configuration(name))
    arms = tuple(yumi_arm(robot, arm, grasps) for arm, grasps in held.grasps.items())
    body = Body.from_mesh(held.vertices, held.triangles, held.center_of_mass)
    bounds = workspace(robot, arms, q, body, VOLUME)
    environment = Environment.from_points(cloud(SCENES[scene], slope), VOLUME, bounds=bounds)
    return Problem(robot, arms, q, body, VOLUME, environment)


def task_of(scene, name, slope):
    solids = [
        SimpleNamespace(name=b.name, vertices=turned(b.vertices, slope)) for b in SCENES[scene]
    ]
    world = SimpleNamespace(parts=[FLOOR, *solids], volume=VOLUME)
    return yumi_task(world, object_by_name(name), support="polygon")


@functools.cache
def found(scene, name, slope):
    problem = problem_of(scene, name, slope)
    planner = PlacementPlanner(problem, aside, POLYGON, np.random.default_rng(0))
    placements = list(planner.run(lambda: planner.statistics.samples >= 1500))
    return problem, placements, yumi_checker(task_of(scene, name, slope))


@pytest.mark.parametrize(("scene", "name", "slope"), RUNS, ids=str)
def test_what_is_published_is_right(scene, name, slope):
    problem, placements, checker = found(scene, name, slope)
    arms = {arm.name: arm for arm in problem.arms}
    assert placements
    previous = None
    for placement in placements:
        solution = Solution.of(placement, arms[placement.arm])
        assert checker.check(solution, previous) == []
        previous = placement.objective


@pytest.mark.parametrize(("scene", "name", "slope"), RUNS, ids=str)
def test_what_is_placed_stays_where_it_is(scene, name, slope):
    pytest.importorskip("mujoco")
    from by_hand.settle_cases import FRICTIONS, MOVED, TILTED
    from helpers.settle import settle_placed

    _, placements, checker = found(scene, name, slope)
    held = object_by_name(name)
    for placement in placements[-1:]:
        for friction in FRICTIONS:
            T = placement.T_world_object
            result = settle_placed(checker.task.solids, held, T, friction=friction)
            assert result.moved < MOVED
            assert result.tilted < TILTED


def test_the_checker_refuses_what_hangs_over_too_far():
    _, placements, checker = found(*RUNS[0])
    T = placements[-1].T_world_object.homogeneous.copy()
    assert check_stance(checker.task, T, checker.tolerances) == []
    center = T[:3, :3] @ checker.task.center_of_mass + T[:3, 3]
    for over, words in ((0.014, "mm within"), (0.03, "mm within"), (0.3, "fewer than three")):
        wrong = T.copy()
        wrong[1, 3] += over - (center[1] - 0.0)
        wrong[1, 3] += 0.004
        said = check_stance(checker.task, wrong, checker.tolerances)
        assert any(words in each for each in said)


def test_where_vertices_find_nothing_polygon_is_named_and_helps():
    problem = problem_of("pedestal", "large_crayons_box", (0.0, 0.0))
    planner = PlacementPlanner(problem, aside, PlannerSettings(), np.random.default_rng(0))
    assert list(planner.run(lambda: planner.statistics.samples >= 1500)) == []
    told = planner.explain()
    words = next(each.words for each in told.remedies if each.parameter == "support")
    assert words.startswith("polygon, ")
    other = PlacementPlanner(problem, aside, POLYGON, np.random.default_rng(0))
    assert next(other.run(lambda: other.statistics.samples >= 3000), None) is not None


def test_where_polygon_finds_nothing_it_is_said_by_its_margin_and_no_more_named():
    problem = problem_of("pedestal", "large_crayons_box", (0.0, 0.0))
    wide = replace(POLYGON, support_margin=0.028)
    planner = PlacementPlanner(problem, aside, wide, np.random.default_rng(0))
    assert list(planner.run(lambda: planner.statistics.samples >= 600)) == []
    told = planner.explain()
    assert "support" in str(told)
    (margin,) = [each.words for each in told.remedies if each.parameter == "support_margin"]
    assert "0.028 m is set" in margin
    named = [each.parameter for each in told.remedies]
    assert "support" not in named
    assert "edge_margin" not in named


@pytest.mark.parametrize("height", np.linspace(-0.0095, 0.0, 4))
def test_overhang_is_free_wherever_the_cells_lie(height):
    """The side of a bridge is in the cells beneath what hangs over it; of its points some are
    3.1 mm below its top."""
    held = object_by_name("large_crayons_box")
    body = Body.from_mesh(held.vertices, held.triangles, held.center_of_mass)
    problem = problem_on(body, [Block("bridge", (0.2, 0.8), (-0.03, 0.03), z=height, depth=0.0191)])
    poses = PoseConstraints(problem, POLYGON.collision, POLYGON.footing, 0.03)
    rng = np.random.default_rng(0)
    contacts = np.array([poses.contacts.regions[0].sample(rng) for _ in range(300)])
    faces = rng.integers(len(body.faces), size=300)
    verdicts, _ = poses.verdicts(faces, contacts, rng.uniform(0.0, 6.3, 300))
    assert (verdicts == Verdict.COLLIDING).sum() == 0
    assert (verdicts == Verdict.FEASIBLE).sum() > 100
