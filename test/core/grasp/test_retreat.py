"""Release and retreat: the open hand against brute force, and refusals of the checker."""

import copy
import re
from dataclasses import asdict, replace
from itertools import pairwise
from types import SimpleNamespace

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from by_hand.verify_cases import case_checker
from checker import Solution, SolutionChecker
from helpers.problems import problem_of
from scipy.spatial import ConvexHull

from benchmarks.cases import Case
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.grasp import open_hand
from placement_planner_ros.core.grasp.hand_opening import opening_error, with_opening_hand
from placement_planner_ros.core.grasp.open_hand import OpenHand
from placement_planner_ros.core.grasp.settings import GraspSettings, RetreatSettings
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.core.types import Verdict
from placement_planner_ros.scenes.primitives import box

CASE = Case("table", "toy_table", "maximize_clearance")
NOTHING = ObstacleSet.from_points(np.zeros((0, 3)), GridSettings(), (np.zeros(3), np.ones(3)))

CLAW = """<robot name="claw">
  <link name="base"/>
  <link name="hand"><collision><geometry><box size="0.06 0.06 0.02"/></geometry></collision></link>
  <joint name="lift" type="prismatic"><parent link="base"/><child link="hand"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <link name="finger"><collision><origin xyz="0 0 0.05"/>
    <geometry><box size="0.01 0.02 0.1"/></geometry></collision></link>
  <joint name="grip" type="revolute"><parent link="hand"/><child link="finger"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="1.5" velocity="1" effort="1"/></joint>
  <link name="thumb"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
  <joint name="thumb_joint" type="revolute"><parent link="finger"/><child link="thumb"/>
    <origin xyz="0 0 0.1"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/>
    <mimic joint="grip" multiplier="-1"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def problem():
    return problem_of(CASE)[0]


@pytest.fixture(scope="module")
def planned():
    problem, objective = problem_of(CASE)
    planner = PlacementPlanner(problem, objective, PlannerSettings(), np.random.default_rng(0))
    placement = next(planner.run(lambda: planner.statistics.samples > 5000))
    return problem, planner, placement


def open_hand_of(problem, arm, obstacles=NOTHING, **settings):
    moving = MovingArm(problem.robot, arm, problem.q_start)
    grasping = GraspSettings(retreat=RetreatSettings(**settings))
    return OpenHand(moving, problem.body, obstacles, grasping)


def hulls(robot: Robot, q, link: str):
    """Convex pieces (n, 3) of a link in the world."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    for name, thing in zip(robot.geometry_links, robot.geometry.geometryObjects, strict=True):
        if name == link:
            shape, T = thing.geometry, data.oMi[thing.parentJoint] * thing.placement
            if isinstance(shape, coal.Sphere):
                points = np.random.default_rng(0).normal(size=(200, 3))
                points *= shape.radius / np.linalg.norm(points, axis=1)[:, None]
            elif isinstance(shape, coal.Box):
                points = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T * shape.halfSide
            else:
                points = np.array([shape.point(i) for i in range(shape.num_points)])
            yield points @ T.rotation.T + T.translation, shape.getSweptSphereRadius()


def outside(points, pieces):
    """How far the furthest of the points is from all of the pieces, about."""
    least = np.full(len(points), np.inf)
    for vertices, radius in pieces:
        planes = ConvexHull(vertices).equations
        least = np.minimum(least, (points @ planes[:, :3].T + planes[:, 3]).max(axis=1) - radius)
    return float(least.max())


@pytest.mark.parametrize(("which", "count"), [("sliding", 1), ("turning", 48), ("beside", 24)])
def test_the_opening_hand_holds_every_stage_of_its_opening_and_little_more(which, count, problem):
    if which == "sliding":
        robot, arm, q = problem.robot, problem.arms[0], problem.q_start
        fingers = [link for link in arm.touch_links if "finger" in link]
        thickness = 1e-9
    else:
        whose = "finger" if which == "turning" else "hand"
        claw = CLAW.replace('"finger"/><child link="thumb', f'"{whose}"/><child link="thumb')
        robot = Robot.from_urdf(claw, srdf="<robot name='claw'/>")
        arm = robot.arm("claw", "hand", gripper_joints=("grip",), gripper_open=(1.2,))
        q = robot.configuration({"lift": 0.1, "grip": 0.0})
        fingers = ["finger", "thumb"]
        thickness = 5e-4
    sweep = with_opening_hand(robot, arm, q)
    unmoved = len([link for link in robot.geometry_links if link not in fingers])
    assert len([link for link in sweep.geometry_links if link not in fingers]) == unmoved
    q_open = robot.with_open_hand(q, arm)
    for link in fingers:
        pieces = list(hulls(sweep, q, link))
        for share in np.linspace(0.0, 1.0, 37):
            stage = robot.with_positions(
                q,
                {
                    j: (1 - share) * q[robot.index(j)] + share * q_open[robot.index(j)]
                    for j in arm.gripper_joints
                },
            )
            for points, _ in hulls(robot, stage, link):
                assert outside(points, pieces) <= 1e-9
        assert all(radius <= thickness for _, radius in pieces)
        assert len(pieces) == count * len(list(hulls(robot, q, link)))


@pytest.fixture(scope="module")
def post(planned):
    """(3,) a point that a finger passes as it opens at the goal."""
    problem, _, placement = planned
    arm = next(a for a in problem.arms if a.name == placement.goal.arm)
    reached = dict(zip(arm.joints, placement.goal.q, strict=True))
    q = problem.robot.with_positions(problem.q_start, reached)
    closed, opened = (
        np.vstack([p for link in arm.touch_links for p, _ in hulls(problem.robot, s, link)])
        for s in (q, problem.robot.with_open_hand(q, arm))
    )
    moving = np.argmax(np.linalg.norm(opened - closed, axis=1))
    return closed[moving] + 0.8 * (opened - closed)[moving]


def test_where_the_fingers_cannot_open_there_is_no_goal(planned, post):
    """The verdict of a placing motion, not only what the open hand says."""
    problem, planner, placement = planned
    goal = placement.goal
    holding = copy.copy(planner.holdings[goal.arm, goal.grasp])
    poses = planner.sampler._checker._poses

    def motion():
        return holding.placing_motion(goal.q, goal.T_world_object, goal.contact, poses)

    assert motion().retreat is not None
    near = post + 0.002 * np.random.default_rng(0).uniform(-1, 1, (50, 3))
    obstacles = ObstacleSet.from_points(near, GridSettings(), (post - 0.3, post + 0.3))
    holding.open_hand = open_hand_of(problem, holding.arm, obstacles)
    assert motion() is Verdict.NO_RELEASE
    holding.require_retreat = False
    assert motion().retreat is None


def test_the_retreat_is_straight_long_enough_and_ends_free_of_the_object(planned):
    _, planner, placement = planned
    goal = placement.goal
    holding = planner.holdings[goal.arm, goal.grasp]
    assert np.array_equal(goal.retreat[0], goal.q)
    tips = holding.chain.forward_batch(goal.retreat)
    way = tips[:, :3, 3] - tips[0, :3, 3]
    direction = way[-1] / np.linalg.norm(way[-1])
    assert np.linalg.norm(way[-1]) >= 0.1 - 1e-4
    assert np.abs(way - (way @ direction)[:, None] * direction).max() < 1e-4
    assert np.abs(tips[:, :3, :3] - tips[0, :3, :3]).max() < 1e-3
    assert np.array_equal(placement.retreat.positions[0], placement.trajectory.positions[-1])
    assert placement.retreat.joints == placement.trajectory.joints


@pytest.fixture(scope="module")
def judged(planned):
    problem, _, placement = planned
    arm = next(a for a in problem.arms if a.name == placement.goal.arm)
    return case_checker(asdict(CASE)), Solution.of(placement, arm)


def curve(retreat, **changes):
    names = ("joints", "times", "positions", "velocities", "accelerations")
    return SimpleNamespace(**{n: getattr(retreat, n) for n in names} | changes)


def at_rest(retreat, positions):
    """Slowly from one configuration (n, dof) to the next, at rest at each."""
    still = np.zeros_like(positions)
    return curve(
        retreat,
        times=5.0 * np.arange(len(positions)),
        positions=positions,
        velocities=still,
        accelerations=still,
    )


def test_the_checker_refuses_a_finger_dragged_through_the_object(planned, judged):
    """The hand leaves along its closing direction."""
    _, planner, placement = planned
    checker, solution = judged
    ik = planner.holdings[placement.goal.arm, placement.goal.grasp].open_hand._ik
    tip = ik.chain.forward(placement.goal.q)
    positions = [solution.retreat.positions[0]]
    for _ in range(8):
        J = ik.chain.jacobian(positions[-1], np.eye(4))[:3]
        positions.append(positions[-1] + np.linalg.pinv(J) @ (0.005 * tip[:3, 0]))
    positions = np.array(positions)
    found = checker.check(replace(solution, retreat=at_rest(solution.retreat, positions)))
    assert any("finger" in v and "object" in v for v in found if v.startswith("retreat: coll"))


def test_the_checker_refuses_fingers_that_open_into_something(judged, post):
    checker, solution = judged
    solid = box("post", post - 0.001, post + 0.001, (1.0, 0.0, 0.0))
    task = replace(checker.task, solids=[*checker.task.solids, solid], objective="none")
    found = SolutionChecker(task, checker.tolerances).check(solution)
    assert any("finger" in v and "post" in v for v in found if v.startswith("release"))


def test_without_requiring_it_a_placement_may_be_without_retreat(monkeypatch):
    problem, objective = problem_of(CASE)
    # through the table
    monkeypatch.setattr(open_hand, "_TIP_DIRECTIONS", [])
    monkeypatch.setattr(open_hand, "UP", np.array([0.0, 0.0, -1.0]))
    impossible = RetreatSettings(retreat_distance=0.5)
    settings = replace(PlannerSettings(), require_retreat=False, retreat=impossible)
    planner = PlacementPlanner(problem, objective, settings, np.random.default_rng(0))
    placement = next(planner.run(lambda: planner.statistics.samples > 3000))
    assert placement.retreat is None
    settings = replace(settings, require_retreat=True)
    planner = PlacementPlanner(problem, objective, settings, np.random.default_rng(0))
    assert list(planner.run(lambda: planner.statistics.samples > 300)) == []
    assert planner.statistics.rejected["no_retreat"] > 0


JAWS = """<robot name="jaws">
  <link name="base"/>
  <link name="hand"><collision><origin xyz="0 0 -0.02"/>
    <geometry><box size="0.1 0.03 0.02"/></geometry></collision></link>
  <joint name="lift" type="prismatic"><parent link="base"/><child link="hand"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <link name="finger"><collision><origin xyz="0 0 0.03"/>
    <geometry><box size="0.01 0.02 0.06"/></geometry></collision></link>
  <joint name="slide" type="prismatic"><parent link="hand"/><child link="finger"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.1" velocity="1" effort="1"/></joint>
</robot>"""


def block(parts):
    """An object of boxes, each centre and size."""
    meshes = []
    for centre, size in parts:
        mesh = trimesh.creation.box(size)
        mesh.apply_translation(centre)
        meshes.append(mesh)
    joined = trimesh.util.concatenate(meshes)
    return Body.from_mesh(joined.vertices, joined.faces)


def jaws(opened, depth=0.0, **start):
    """The jaws whose palm is so far in what they hold; they open to `opened`, metres."""
    robot = Robot.from_urdf(JAWS)
    arm = robot.arm(
        "arm",
        "hand",
        grasps=[pin.SE3(np.eye(3), np.array([0.0, 0.0, -depth]))],
        gripper_joints=["slide"],
        gripper_open=[opened],
    )
    return MovingArm(robot, arm, robot.configuration({"lift": 0.5, "slide": 0.0} | start))


@pytest.mark.parametrize(
    ("wall", "depth"),
    [(None, None), (0.15, None), (0.061, None), (0.055, "0.0055 m"), (0.035, "0.009")],
)
def test_a_hand_whose_finger_opens_into_the_object_is_refused(wall, depth):
    pads = [((-0.02, 0.0, 0.05), (0.03, 0.02, 0.04))]
    if wall is not None:  # beyond the open finger, met by its end, or passed through
        pads.append(((wall, 0.0, 0.05), (0.01, 0.02, 0.04)))
        pads.append(((wall / 2 - 0.01, 0.0, 0.1), (wall + 0.05, 0.02, 0.01)))
    body = block(pads)
    error = opening_error(jaws(0.0505, slide=0.0005), AttachedObject(body))
    assert (error is None) == (depth is None)
    if depth is not None:
        assert re.search(rf"grasps\[0\]` of arm arm.*pushes finger {depth}", str(error))


def jaws_over(body, opened, depth=0.0):
    """The jaws around a body, opened, and what they touch; they retreat from 0.5 m on."""
    moving = jaws(opened, depth)
    hand = OpenHand(moving, body, NOTHING, GraspSettings())
    T_world_object = moving.robot.link_pose(moving.q_rest, "hand") * moving.arm.grasps[0]
    way = hand.retreat(np.array([0.5]), 0, T_world_object)
    return hand, T_world_object, way, set(hand.touching[0])


BESIDE_FINGER = block([((-0.02, 0.0, 0.05), (0.03, 0.02, 0.04))])


@pytest.mark.parametrize(
    ("opened", "touching", "leaves"),
    [(0.0, True, False), (1e-4, True, False), (5e-4, True, True), (2e-3, False, True)],
)
def test_a_finger_does_not_slide_along_the_object_all_the_way(opened, touching, leaves):
    """Open, it lies flat against the side that it held."""
    _, _, way, touched = jaws_over(BESIDE_FINGER, opened)
    assert touched == ({"finger"} if touching else set())
    assert (way is not None) == leaves


@pytest.mark.parametrize(("depth", "leaves"), [(0.0, True), (0.0025, True), (0.0035, False)])
def test_a_palm_may_come_off_on_the_first_millimetres(depth, leaves):
    on_palm = block([((-0.03, 0.0, 0.03), (0.03, 0.02, 0.08))])
    hand, T, way, touched = jaws_over(on_palm, 0.03, depth)
    assert touched == {"hand"}
    assert (way is not None) == leaves
    if not leaves:
        return
    assert way[1, 0] == pytest.approx(0.497, abs=1e-4)
    free = hand.edge_free(0, T, way)
    still = np.zeros(1)
    assert all(free(a, b, still) for a, b in pairwise(way))
    assert free(way[0], way[-1], still)  # cut where less may touch
    # After 3 mm it may not be there.
    assert not hand._open.free(way[0])
    assert not free(np.array([0.5]), np.array([0.506]), still) or depth == 0.0


@pytest.mark.parametrize("lip", [False, True])
def test_what_has_come_off_must_not_meet_the_object_again(lip):
    """The palm lifts off, and a finger with nothing beside it meets a lip further up."""
    parts = [((-0.03, 0.0, 0.03), (0.03, 0.02, 0.08))]
    if lip:
        parts.append(((0.02, 0.0, -0.06), (0.13, 0.02, 0.005)))
    _, _, way, touched = jaws_over(block(parts), 0.03)
    assert touched == {"hand"}
    assert (way is None) == lip


def cup_over_the_jaws(inner):
    """So wide inside, its wall 4 mm, its mouth at z = 0.03, towards the palm."""
    outer, high = inner + 0.004, 0.05
    profile = [(0.0, 0.0), (outer, 0.0), (outer, high), (inner, high), (inner, 0.004), (0.0, 0.004)]
    mesh = trimesh.creation.revolve(np.array(profile), sections=64)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0]))
    mesh.apply_translation([0.0, 0.0, 0.08])
    return Body.from_mesh(mesh.vertices, mesh.faces)


def test_a_hand_inside_of_a_hollow_object_is_not_in_it():
    """A bowl held by its rim: the hull would hold finger and palm."""
    body = cup_over_the_jaws(0.046)
    assert body.mesh is not None
    _, _, way, touched = jaws_over(body, 0.02)
    assert touched == set()
    assert way is not None
    # pushed on, the finger's end is in the bowl's ground
    _, _, way, touched = jaws_over(body, 0.02, 0.018)
    assert touched == {"finger"}
    assert way is not None
    _, _, way, _ = jaws_over(body, 0.02, 0.022)
    assert way is None


@pytest.mark.parametrize(("gap", "bad"), [(0.03, False), (0.012, True)])
def test_a_finger_that_opens_into_a_mesh_is_refused(gap, bad):
    """Held by the rim of a cup: the finger inside opens towards the other side."""
    error = opening_error(jaws(0.015), AttachedObject(cup_over_the_jaws(gap)))
    assert (error is not None) == bad
    assert not bad or re.search(r"pushes finger 0\.0\d+ m", str(error))
