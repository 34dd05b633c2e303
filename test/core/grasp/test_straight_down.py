"""The way down: the bound on how far the object strays, and the margin on all that is published."""

from dataclasses import asdict, replace
from types import SimpleNamespace
from unittest import mock

import coal
import numpy as np
import pinocchio as pin
import pytest
from by_hand.verify_cases import case_checker
from checker import Solution, SolutionChecker
from helpers.problems import problem_of
from scipy.interpolate import BPoly
from scipy.spatial import ConvexHull

from benchmarks.cases import Case, make_problem
from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.grasp import straight_down
from placement_planner_ros.core.grasp.straight_down import stray
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.timing.quintic import control_points
from placement_planner_ros.core.timing.trajectory_maker import TimingSettings, TrajectoryMaker

MARGIN, TOLERANCE = 0.003, 0.003
SLIDING = """<robot name="sliding">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 0.2"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0.1 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.5" velocity="1" effort="1"/></joint>
  <joint name="roll" type="revolute"><parent link="b"/><child link="c"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
</robot>"""


def sampled_stray(chain, points, vertices, placed, count=400):
    """The same by brute force: the distance from each line, at many instants of each piece."""
    furthest, height = 0.0, None
    for piece in points:
        curve = BPoly(piece[:, None], [0.0, 1.0])
        for q in curve(np.linspace(0.0, 1.0, count)):
            T = chain.forward(q)
            away = vertices @ T[:3, :3].T + T[:3, 3] - placed
            if height is None:
                height = max(away[:, 2].min(), 0.0)
            nearest = np.clip(away[:, 2], 0.0, height)
            away[:, 2] -= nearest
            furthest = max(furthest, np.linalg.norm(away, axis=1).max())
    return furthest


@pytest.mark.parametrize("kind", ["yumi", "sliding"])
def test_the_bound_holds_and_is_tight(kind):
    rng = np.random.default_rng(0)
    if kind == "yumi":
        problem, _ = make_problem(
            Case("table", "small_crayons_box", "maximize_clearance"), np.random.default_rng(0)
        )
        robot, arm, q = problem.robot, problem.arms[0], problem.q_start
    else:
        robot = Robot.from_urdf(SLIDING)
        arm = robot.arm("arm", "c")
        q = np.zeros(3)
    chain = Chain.from_robot(robot, arm, q)
    for size in (1e-4, 0.01, 0.3):
        for _ in range(15):
            start = rng.uniform(chain.lower, chain.upper)
            points = start + size * np.cumsum(rng.normal(size=(12, chain.dof)), axis=0)
            points = np.clip(points, chain.lower, chain.upper).reshape(2, 6, chain.dof)
            vertices = rng.uniform(-0.1, 0.1, (7, 3))
            T = chain.forward(points[-1, -1])
            placed = vertices @ T[:3, :3].T + T[:3, 3]
            bound = stray(chain, points, vertices, placed)
            seen = sampled_stray(chain, points, vertices, placed)
            assert seen - 1e-9 <= bound <= seen + 3.0 * straight_down._BENT


def test_what_happens_between_two_samples_counts():
    """An excursion of half a millimetre amid a piece whose ends are on the line."""
    robot = Robot.from_urdf(SLIDING)
    chain = Chain.from_robot(robot, robot.arm("arm", "c"), np.zeros(3))
    points = np.tile([0.0, 0.3, 0.0], (1, 6, 1))
    points[0, 2, 1] += 0.001
    vertices = np.zeros((1, 3))
    T = chain.forward(points[0, 0])
    assert sampled_stray(chain, points, vertices, T[:3, 3]) > 0.0003
    assert stray(chain, points, vertices, T[:3, 3]) > 0.0003


@pytest.fixture(scope="module")
def planned():
    """Two cases with all that was published for them."""
    runs = []
    for case in (
        Case("table", "small_crayons_box", "minimize_clearance"),
        Case("cabinet_high_clutter", "toy_table", "minimize_clearance"),
    ):
        problem, objective = problem_of(case)
        planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(0))
        runs.append((case, problem, planner, list(planner.run(_enough(planner)))))
    return runs


def _enough(planner):
    return lambda: planner.statistics.samples >= 3000


def chords(waypoints):
    """Control points of the straight joint motions between (k, dof) waypoints."""
    share = np.linspace(0.0, 1.0, 6)[:, None]
    return waypoints[:-1, None] + share * np.diff(waypoints, axis=0)[:, None]


def lines(holding, vertices, T_world_object):
    """The chain, the object's vertices in the tip's frame, and where they are placed."""
    T = holding.arm.grasps[holding.grasp]
    placed = vertices @ T_world_object.rotation.T + T_world_object.translation
    return vertices @ T.rotation.T + T.translation, placed


def test_approaches_follow_the_vertical_where_evenly_spaced_steps_would_not(planned):
    """Steps of a centimetre stray by more than a third of a millimetre here and there."""
    _, problem, planner, _ = planned[0]
    rng = np.random.default_rng(0)
    kept = CollisionSettings().approach_stray
    coarse, refined = [], []
    for holding in planner.holdings.values():
        for q in rng.uniform(holding.arm.lower, holding.arm.upper, (3000, holding.arm.dof)):
            T = holding.object_pose(q)
            lowest = (problem.body.vertices @ T.rotation.T + T.translation)[:, 2].min()
            if not 0.005 < lowest < 0.3 or not holding.free_at_contact(q):
                continue
            approach = holding._approach(q, T, -1.0, planner._optimizer._poses)
            if approach is None:
                continue
            vertices, placed = lines(holding, problem.body.vertices, T)
            above = [q]
            for height in (
                holding.object_pose(approach[0]).translation[2]
                - T.translation[2]
                - (np.arange(4, -1, -1) * 0.01)
            ):
                if height > 0.005:
                    up = pin.SE3(T.rotation, T.translation + np.array([0.0, 0.0, height]))
                    q_next = holding.follow(up, above[-1])
                    above += [] if q_next is None else [q_next]
            even = np.array(above[::-1])
            coarse.append(sampled_stray(holding.chain, chords(even), vertices, placed, 8))
            refined.append(sampled_stray(holding.chain, chords(approach), vertices, placed, 8))
            if len(refined) >= 40 * len(planner.holdings):
                break
    assert len(refined) >= 20
    assert max(refined) <= 0.75 * kept
    assert max(coarse) > 1.5 * kept


def test_timed_ways_down_stay_on_the_line(planned):
    for _, problem, planner, placements in planned:
        for placement in placements:
            goal, curve = placement.goal, placement.trajectory
            holding = planner.holdings[goal.arm, goal.grasp]
            first = int(np.searchsorted(curve.times, placement.approach_start - 1e-9))
            points = control_points(
                *(
                    getattr(curve, name)[first:]
                    for name in ("times", "positions", "velocities", "accelerations")
                )
            )
            vertices, placed = lines(holding, problem.body.vertices, goal.T_world_object)
            seen = sampled_stray(holding.chain, points, vertices, placed, 12)
            assert seen <= CollisionSettings().approach_stray


def test_what_leaves_the_line_is_not_published(planned):
    """The same goal approached in one step of five centimetres."""
    refused = 0
    for _, problem, planner, placements in planned:
        for placement in placements:
            goal = placement.goal
            holding = planner.holdings[goal.arm, goal.grasp]
            path = np.array([holding.q_start, goal.q_raised])
            coarse = goal.approach[[0, -1]]
            vertices, placed = lines(holding, problem.body.vertices, goal.T_world_object)
            strays = sampled_stray(holding.chain, chords(coarse), vertices, placed)
            if strays < 0.001:
                continue
            maker = TrajectoryMaker(TimingSettings(), 0.0, np.random.default_rng(0))
            with mock.patch("placement_planner_ros.core.collision.arm.ArmCollision.edge_free") as f:
                f.return_value = True
                made = maker.make(path, goal, holding, lambda: False)
                assert made is not None
                made = maker.make(path, replace(goal, approach=coarse), holding, lambda: False)
                assert made is None
            refused += 1
    assert refused > 0


def convex(vertices):
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    hull = ConvexHull(vertices)
    for vertex in vertices:
        points.append(vertex)
    for (a, b, c), plane in zip(hull.simplices.tolist(), hull.equations, strict=True):
        n = np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a])
        faces.append(coal.Triangle(*((a, b, c) if n @ plane[:3] > 0 else (a, c, b))))
    return coal.Convex(points, faces)


def poses_on_the_way_down(problem, placement, count=600):
    """Where pinocchio puts the object, from the approach's beginning to its end."""
    arm = next(a for a in problem.arms if a.name == placement.goal.arm)
    curve = placement.trajectory
    piece = [
        np.array([curve.positions[i], curve.velocities[i], curve.accelerations[i]])
        for i in range(len(curve.times))
    ]
    hermite = BPoly.from_derivatives(curve.times, piece)
    model, data = problem.robot.model, problem.robot.model.createData()
    tip = model.getFrameId(arm.tip_frame)
    q = problem.q_start.copy()
    for t in np.linspace(placement.approach_start, curve.times[-1], count):
        q[arm.q_index] = hermite(t)
        pin.framesForwardKinematics(model, data, q)
        yield data.oMf[tip] * arm.grasps[placement.goal.grasp]


def nearest_on_the_way_down(problem, placement):
    """metres, of the object from any box that is not its support, by coal."""
    obstacles = problem.environment.obstacles
    contact = placement.goal.contact_height
    others = np.abs(obstacles.upper[:, 2] - contact) > TOLERANCE
    poses = list(poses_on_the_way_down(problem, placement))
    vertices = problem.body.vertices
    every = np.vstack([vertices @ T.rotation.T + T.translation for T in poses[::20]])
    others &= (obstacles.lower < every.max(axis=0) + 0.006).all(axis=1)
    others &= (obstacles.upper > every.min(axis=0) - 0.006).all(axis=1)
    boxes = [
        (coal.Box(u - w), coal.Transform3s(np.eye(3), (u + w) / 2))
        for w, u in zip(obstacles.lower[others], obstacles.upper[others], strict=True)
    ]
    request, least = coal.DistanceRequest(), np.inf
    for part in problem.body.parts:
        shape = convex(np.asarray(part.vertices))
        nearby = None
        for T in poses:
            at = coal.Transform3s(T.rotation, T.translation)
            if nearby is None:  # the whole way is no longer than that
                nearby = [
                    b
                    for b in boxes
                    if coal.distance(shape, at, *b, request, coal.DistanceResult()) < 0.07
                ]
            for b in nearby:
                gap = coal.distance(shape, at, *b, request, coal.DistanceResult())
                least = min(least, gap)
    return least


def test_the_object_keeps_the_margin_all_the_way_down(planned):
    for _, problem, _, placements in planned:
        assert placements
        for placement in placements[-3:]:
            assert nearest_on_the_way_down(problem, placement) >= MARGIN - 1e-5


def test_the_checker_accepts_what_is_published_and_tests_the_margin(planned):
    """A box put a hair nearer than the margin beside the way down is noticed."""
    case, problem, _, placements = planned[0]
    checker = case_checker(asdict(case))
    placement = placements[-1]
    arm = next(a for a in problem.arms if a.name == placement.goal.arm)
    solution = Solution.of(placement, arm)
    assert checker.check(solution) == []
    curve = placement.trajectory
    down = slice(int(np.searchsorted(curve.times, placement.approach_start - 1e-9)), None)
    names = ("times", "positions", "velocities", "accelerations")
    only = SimpleNamespace(joints=curve.joints, **{n: getattr(curve, n)[down] for n in names})
    descent = replace(solution, trajectory=only, retreat=None)
    T = placement.T_world_object
    corners = problem.body.vertices @ T.rotation.T + T.translation
    outermost = corners[corners[:, 0].argmin()]
    for gap, fine in ((MARGIN + 5e-4, True), (MARGIN - 1e-4, False)):
        lower = outermost + np.array([-gap - 0.001, -0.001, 0.004])
        extra = np.stack([lower, lower + np.array([0.001, 0.002, 0.002])])[:, None]
        task = replace(checker.task, measured=np.concatenate([checker.task.measured, extra], 1))
        found = SolutionChecker(task, checker.tolerances).check(descent)
        assert (not [v for v in found if v.startswith("margin: object")]) == fine
