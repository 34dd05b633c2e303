"""The checker accepts a right solution, made by hand, and refuses each kind of wrong one."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from helpers.right_solution import (
    CHECKER,
    GOOD,
    JOINTS,
    OBJECTIVE,
    Q_START,
    STILL,
    TASK,
    TIMES,
    TOLERANCES,
    WAYPOINTS,
)

import checker
from benchmarks.household import object_by_name
from checker import (
    RobotModel,
    Solution,
    SolutionChecker,
    Task,
    Tolerances,
    World,
    object_pieces,
    piece_voxels,
    states_along,
)
from placement_planner_ros.core.types import Goal, Placement, Trajectory
from placement_planner_ros.scenes.primitives import box
from placement_planner_ros.scenes.yumi import load_yumi, yumi_arm

RED = (1.0, 0.0, 0.0)


def with_curve(
    times: np.ndarray = TIMES,
    positions: np.ndarray = WAYPOINTS,
    velocities: np.ndarray = STILL,
    accelerations: np.ndarray = STILL,
) -> Solution:
    return replace(GOOD, trajectory=Trajectory(JOINTS, times, positions, velocities, accelerations))


def test_reads_a_published_placement() -> None:
    arm = yumi_arm(load_yumi(), "left", object_by_name("small_crayons_box").grasps["left"])
    pose = pin.SE3(GOOD.placement_pose)
    goal = Goal("left", 0, 0, pose, 0.0, WAYPOINTS[1:], OBJECTIVE)
    placement = Placement(goal, GOOD.trajectory, 4.0, 0.0, 0)
    assert CHECKER.check(Solution.of(placement, arm)) == []


def moved(array: np.ndarray, where: tuple[int, int], value: float) -> np.ndarray:
    copy = array.copy()
    copy[where] = value
    return copy


def check(task: Task = TASK, solution: Solution = GOOD, tolerances: Tolerances = TOLERANCES):
    return SolutionChecker(task, tolerances).check(solution)


def raised_table(height: float) -> Task:
    parts = [part for part in TASK.solids if part.name == "table"]
    lower, upper = parts[0].vertices.min(axis=0), parts[0].vertices.max(axis=0)
    return replace(TASK, solids=[box("table", lower, [*upper[:2], height], RED)], objective="none")


def assert_only(violations: list[str], *kinds: str) -> None:
    assert {violation.split(":")[0] for violation in violations} == set(kinds), violations


def test_accepts_the_right_solution() -> None:
    assert CHECKER.check(GOOD) == []
    assert CHECKER.check(GOOD, previous_objective=OBJECTIVE - 0.001) == []


def test_knows_nothing_of_the_planner() -> None:
    imported: set[str | None] = set()
    files = sorted(Path(checker.__file__).parent.glob("*.py"))
    files = [file for file in files if not file.name.startswith("test_")]
    assert len(files) > 5
    for tree in (ast.parse(file.read_text()) for file in files):
        imported |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        imported |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    assert not [name for name in imported if name and name.startswith("placement_planner_ros")]


def test_refuses_another_start() -> None:
    assert_only(check(solution=with_curve(positions=moved(WAYPOINTS, (0, 6), 1e-4))), "start")
    assert_only(check(solution=with_curve(velocities=moved(STILL, (0, 6), 1e-3))), "start")


def test_refuses_times_that_do_not_increase() -> None:
    times = TIMES.copy()
    times[3] = times[2]
    assert check(solution=with_curve(times=times)) == ["trajectory: times do not increase strictly"]


@pytest.mark.parametrize("values", [TIMES, WAYPOINTS])
def test_refuses_what_is_not_finite(values: np.ndarray) -> None:
    bad = values.copy()
    bad.flat[-1] = np.nan
    name = "times" if values is TIMES else "positions"
    assert check(solution=with_curve(**{name: bad})) == ["trajectory: not finite"]


def test_refuses_speed_and_acceleration_between_the_points() -> None:
    hurried = replace(with_curve(times=TIMES * 0.2), approach_start=0.8)
    found = check(solution=hurried, tolerances=Tolerances())
    assert_only(found, "limits")
    assert all("turns at" in violation for violation in found)
    found = check(tolerances=Tolerances(acceleration_limit=0.5))
    assert_only(found, "limits")
    assert all("accelerates at" in violation for violation in found)


def test_refuses_a_range_left_between_the_points() -> None:
    positions = moved(WAYPOINTS, (1, 1), 0.70)  # at most 0.759
    through = check(solution=with_curve(positions=positions, velocities=moved(STILL, (1, 1), 1.5)))
    assert "limits: yumi_joint_2_l leaves its range" in through
    resting = check(solution=with_curve(positions=positions))
    assert "limits: yumi_joint_2_l leaves its range" not in resting


def test_refuses_an_approach_outside_the_trajectory() -> None:
    assert_only(check(solution=replace(GOOD, approach_start=7.1)), "approach_start")


def test_refuses_an_end_in_motion() -> None:
    assert_only(check(solution=with_curve(velocities=moved(STILL, (-1, 6), 1e-3))), "end")


@pytest.mark.parametrize(
    "change",
    [
        pin.SE3(np.eye(3), np.array([0.0008, 0, 0])),
        pin.SE3(pin.utils.rotate("z", np.deg2rad(0.4)), np.zeros(3)),
    ],
)
def test_refuses_a_pose_the_arm_does_not_reach(change: pin.SE3) -> None:
    pose = GOOD.placement_pose.copy()
    pose[:3, 3] += change.translation
    pose[:3, :3] = change.rotation @ pose[:3, :3]
    assert_only(check(solution=replace(GOOD, placement_pose=pose)), "end")


def test_refuses_self_collision() -> None:
    folded = WAYPOINTS.copy()
    folded[1, 5] = 2.3  # link_7 bent back onto link_5
    found = check(solution=with_curve(positions=folded))
    assert any("yumi_link_5_l with yumi_link_7_l" in v or "gripper_l_base" in v for v in found)


def test_refuses_the_other_arm_in_the_way() -> None:
    q = {**Q_START, **{n.replace("_l", "_r"): 0.0 for n in JOINTS}}
    positions = WAYPOINTS.copy()
    positions[1] = 0.0  # both arms at zero meet on the centre line
    found = check(replace(TASK, q_start=q), with_curve(positions=positions))
    assert any("_l" in v and "_r" in v for v in found if v.startswith("collision"))


@pytest.mark.parametrize("size", [0.0, 0.01])
def test_a_shape_of_no_size_on_the_hand_is_no_thing_in_the_object(size: float) -> None:
    mark = (
        f'<link name="mark"><collision><geometry><box size="{size} {size} {size}"/></geometry>'
        '</collision></link><joint name="mark_joint" type="fixed"><parent link="gripper_l_base"/>'
        '<child link="mark"/><origin xyz="0 0 0.125"/></joint></robot>'
    )
    found = check(replace(TASK, urdf=TASK.urdf.replace("</robot>", mark)))
    assert any("mark with object" in v for v in found) == (size > 0.0)
    assert size > 0.0 or not found


def test_refuses_a_thin_wall_in_the_way() -> None:
    """1 mm thick, across the hand's way from the start to the place above the table."""
    q_start = CHECKER.robot.configuration(Q_START)
    q = states_along(CHECKER.robot, GOOD.trajectory, q_start, TASK.object_vertices, 0.002)[0]
    tip = CHECKER.robot.frame_pose(q[len(q) // 3], "gripper_l_base")[:3, 3]
    half = np.array([0.0005, 0.1, 0.1])
    wall = box("wall", tip - half, tip + half, RED)
    assert_only(check(replace(TASK, solids=[*TASK.solids, wall], objective="none")), "collision")


def test_allows_contact_with_the_support_within_its_tolerance_and_only_in_the_approach() -> None:
    assert check(raised_table(0.002)) == []
    late = replace(GOOD, approach_start=7.0)
    assert_only(check(raised_table(0.002), late), "collision")
    assert_only(check(raised_table(0.004)), "collision", "stance")


def test_allows_no_contact_with_anything_else() -> None:
    """A post as high as 2 mm above the table's surface is support; one of 10 mm is not."""
    x, y = GOOD.placement_pose[:2, 3]
    for height, kinds in ((0.002, ()), (0.010, ("collision",))):
        post = box("post", [x - 0.005, y - 0.005, -0.01], [x + 0.005, y + 0.005, height], RED)
        task = replace(TASK, solids=[*TASK.solids, post], objective="none")
        assert_only(check(task), *kinds)


def test_refuses_to_stand_on_nothing() -> None:
    assert_only(check(raised_table(-0.005)), "stance")
    x, y = GOOD.placement_pose[:2, 3]
    post = box("post", [x - 0.01, y - 0.01, -0.1], [x + 0.01, y + 0.01, 0.0], RED)
    assert_only(check(replace(TASK, solids=[post], objective="none")), "stance")


def test_refuses_to_stand_on_an_edge_or_with_its_weight_beyond() -> None:
    tilted = GOOD.placement_pose.copy()
    tilted[:3, :3] = pin.utils.rotate("x", 0.2) @ tilted[:3, :3]
    assert "stance: stands on an edge or a corner" in check(
        solution=replace(GOOD, placement_pose=tilted)
    )
    heavy = replace(TASK, center_of_mass=np.array([0.0, 0.0, 0.04]))
    assert "stance: centre of mass beyond the face it stands on" in check(heavy)


def test_refuses_a_place_outside_the_volume() -> None:
    far = replace(TASK, volume_upper=np.array([0.25, 0.4, 0.1]), objective="none")
    assert_only(check(far), "volume")
    high = replace(TASK, volume_lower=np.array([0.17, -0.4, 0.02]), objective="none")
    assert check(high) == ["volume: no contact point in V"]


def test_several_boxes_hold_contact_point_and_centre_of_mass_in_any_of_them() -> None:
    """The box stands with its reference side in one and its middle in the other."""
    feet = GOOD.placement_pose[0, 3]
    low, high = TASK.volume_lower[0], TASK.volume_upper[0]
    left, right = high.copy(), low.copy()
    left[0] = right[0] = feet - 0.005  # what touches ends here, what holds the middle begins
    both = np.array([low, right]), np.array([left, high])
    for order in ([0, 1], [1, 0]):
        two = replace(TASK, volume_lower=both[0][order], volume_upper=both[1][order])
        assert check(two) == []
    half = replace(TASK, volume_lower=low, volume_upper=left, objective="none")
    assert check(half) == ["volume: centre of mass not over V"]
    over = both[0].copy(), both[1].copy()
    over[0][1, 2], over[1][1, 2] = 0.05, 0.1  # at another height it holds nothing that stands at 0
    apart = replace(TASK, volume_lower=over[0], volume_upper=over[1], objective="none")
    assert check(apart) == ["volume: centre of mass not over V"]


def test_refuses_a_wrong_or_no_better_objective() -> None:
    low, high = CHECKER.clearance_bounds(GOOD.placement_pose)
    for wrong in (low - 0.011, high + 0.011):
        assert_only(CHECKER.check(replace(GOOD, objective=wrong)), "objective")
    assert CHECKER.check(GOOD, previous_objective=OBJECTIVE) == ["objective: 0.06466 after 0.06466"]
    minimise = replace(TASK, objective="minimize_clearance")
    assert check(minimise, replace(GOOD, objective=-OBJECTIVE)) == []


def beside_cube(solids: list, **changes) -> SolutionChecker:
    """Of a 10 cm cube standing at the origin, V reaching 1 m."""
    cube = box("cube", [-0.05, -0.05, 0], [0.05, 0.05, 0.1], RED)
    of = {"object_vertices": cube.vertices, "object_triangles": cube.triangles}
    of |= {"volume_lower": -np.ones(3), "volume_upper": np.ones(3)}
    return SolutionChecker(replace(TASK, solids=solids, **(of | changes)))


def clearance_of_cube(solids: list, **changes) -> float:
    return beside_cube(solids, **changes).clearance(np.eye(4))


def test_clearance_is_measured_sideways_and_upwards() -> None:
    ground = box("ground", [-2, -2, -1], [2, 2, 0], RED)
    wall = box("wall", [0.1, -2, 0], [0.2, 2, 1], RED)
    roof = box("roof", [-2, -2, 0.15], [2, 2, 0.2], RED)
    low = box("low", [0.06, -2, 0], [0.07, 2, 0.05], RED)
    assert clearance_of_cube([ground]) == 0.5
    assert clearance_of_cube([ground, wall]) == pytest.approx(0.1, abs=1e-9)
    assert clearance_of_cube([ground, roof]) == pytest.approx(0.1, abs=1e-9)
    # only the lower half of the cube has it beside itself
    assert clearance_of_cube([low]) == pytest.approx((0.06 + 0.5) / 2, abs=1e-9)
    beyond = box("beyond", [1.05, -2, 0], [1.1, 2, 1], RED)
    assert clearance_of_cube([beyond]) == 0.5


def test_clearance_counts_what_lies_in_any_box_or_near_it() -> None:
    wall = box("wall", [0.1, -2, 0], [0.2, 2, 1], RED)
    tight = np.array([-0.06, -0.06, -0.1]), np.array([0.06, 0.06, 0.2])
    far = np.array([0.15, 1.5, 0.0]), np.array([0.3, 1.8, 0.5])
    lower, upper = np.array([tight[0], far[0]]), np.array([tight[1], far[1]])
    near = np.array([tight[1] + [0.1, 0, 0], far[1]])

    def clearance(volume_upper, **changes):
        boxes = {"volume_lower": lower, "volume_upper": volume_upper}
        return clearance_of_cube([wall], **boxes, **changes)

    assert clearance(upper) == 0.5
    assert clearance(near) == pytest.approx(0.1, abs=0.003)
    assert clearance(upper, beyond=0.5) == pytest.approx(0.1, abs=1e-9)


def test_clearance_is_bounded_where_a_layer_decides() -> None:
    """What ends 4 mm above some voxel centres may count for them, or not."""
    judge = beside_cube([box("low", [0.06, -2, 0], [0.07, 2, 0.0565], RED)])
    beside = [0.06 * layers / 20 + 0.5 * (20 - layers) / 20 for layers in (11, 9)]
    assert judge.clearance_bounds(np.eye(4)) == pytest.approx(beside, abs=1e-9)
    assert judge.clearance(np.eye(4)) == pytest.approx(beside[0], abs=1e-9)


ELL = np.array([(0.06, 0.06), (0.06, 0.3), (0.0, 0.3), (0.0, 0.0), (0.25, 0.0), (0.25, 0.06)])


@pytest.fixture(scope="module")
def ell(tmp_path_factory):
    """A URDF of an L of mesh, 6 cm thick, on a slide; its hull fills the L's inner corner."""
    k = len(ELL)
    flat = np.column_stack([ELL, np.zeros(k)])
    fan = [[0, i + 1, i] for i in range(1, k - 1)]
    faces = [*fan, *[[k + a, k + c, k + b] for a, b, c in fan]]
    faces += [[i, (i + 1) % k, k + i] for i in range(k)]
    faces += [[(i + 1) % k, k + (i + 1) % k, k + i] for i in range(k)]
    vertices = np.vstack([flat, np.add(flat, (0.0, 0.0, 0.06))])
    file = tmp_path_factory.mktemp("ell") / "ell.stl"
    trimesh.Trimesh(vertices, faces, process=False).export(file)
    return f"""
    <robot name="ell"><link name="base"/><link name="ell"><collision><geometry>
      <mesh filename="{file}"/></geometry></collision></link>
      <joint name="slide" type="prismatic"><parent link="base"/><child link="ell"/>
      <axis xyz="1 0 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


@pytest.mark.parametrize(
    ("at", "half", "words"),
    [
        ((0.15, 0.15, 0.03), 0.02, ""),  # in the inner corner
        ((0.15, 0.07, 0.03), 0.02, "collision: ell with block"),
        ((0.03, 0.2, 0.03), 0.002, "collision: ell with block"),  # wholly inside
        ((0.03, 0.2, 0.12), 0.002, ""),  # above it
    ],
)
def test_a_mesh_that_is_not_convex_is_what_its_triangles_show(ell, at, half, words):
    block = box("block", np.subtract(at, half), np.add(at, half), RED)
    task = replace(TASK, urdf=ell, srdf="", solids=[block], measured=None)
    curve = Trajectory(("slide",), TIMES[:2], np.zeros((2, 1)), np.zeros((2, 1)), np.zeros((2, 1)))
    solution = replace(GOOD, trajectory=curve, tip_frame="ell", placement_pose=np.eye(4))
    robot = RobotModel.read(ell, "", {})
    assert [closed for _, closed in robot.pieces[0]] == [True]
    world = World.build(robot, task, [], solution, 0.003)
    found = world.sweep(np.zeros((3, 1)), np.zeros(3), np.inf, set(), TOLERANCES)
    assert [words] == [each[: len(words)] for each in found] if words else found == []
    # What was measured there is kept clear of by the margin, inside and outside.
    boxes = np.array([[np.subtract(at, half)], [np.add(at, half)]])
    task = replace(task, solids=[], measured=boxes)
    world = World.build(robot, task, [], solution, 0.003)
    found = world.sweep(np.zeros((3, 1)), np.zeros(3), np.inf, set(), TOLERANCES)
    assert bool(found) is bool(words)
    assert all(each.startswith("margin: ell is") for each in found)


def test_meshes_beside_the_urdf_are_found(ell):
    (file,) = re.findall('filename="(.*)"', ell)
    beside = ell.replace(file, Path(file).name)
    (pieces,) = RobotModel.read(beside, "", {"": Path(file).parent}).pieces.values()
    assert len(pieces) == 1


def test_the_object_is_what_its_triangles_are():
    glass, surface = (object_by_name(name) for name in ("wine_glass", "wine_glass_mesh"))
    solids = object_pieces(glass.vertices, glass.triangles)
    (whole,) = object_pieces(surface.vertices, surface.triangles)
    assert len(solids) == len(glass.parts)
    assert all(piece.solid and piece.closed for piece in solids)
    assert (whole.solid, whole.closed) == (False, True)
    voxels = piece_voxels([whole], 0.0041)
    np.testing.assert_allclose(voxels, piece_voxels(solids, 0.0041), atol=1e-12)
    # without its foot's disk it is a sheet, of which voxels are those it passes through
    (sheet,) = object_pieces(surface.vertices, surface.triangles[:-40])
    assert not sheet.closed
    depth = np.max([part.depth(piece_voxels([sheet])) for part in glass.parts], axis=0)
    assert depth.max() < 0.005
    # triangles that share no vertices are put together
    soup = surface.vertices[surface.triangles].reshape(-1, 3)
    (again,) = object_pieces(soup, np.arange(len(soup)).reshape(-1, 3))
    assert again.closed


@pytest.mark.parametrize(
    ("at", "meets"),
    [
        ((0.0, 0.0, 0.0), False),  # in the hole
        ((0.04, 0.0, 0.0), True),  # wholly inside
        ((0.03, 0.0, 0.0), True),
        ((0.06, 0.0, 0.0), False),
    ],
)
@pytest.mark.parametrize("measured", [False, True])
def test_a_held_ring_meets_what_its_triangles_meet(at, meets, measured):
    ring = trimesh.creation.annulus(r_min=0.03, r_max=0.05, height=0.06)
    solution = GOOD
    robot = RobotModel.read(TASK.urdf, TASK.srdf, TASK.package_dirs)
    q = robot.configuration(Q_START)
    T = robot.frame_pose(q, solution.tip_frame) @ solution.T_tip_object
    centre = T[:3, :3] @ np.array(at) + T[:3, 3]
    block = box("block", centre - 0.001, centre + 0.001, RED)
    boxes = np.array([[centre - 0.001], [centre + 0.001]])
    task = replace(
        TASK,
        object_vertices=np.asarray(ring.vertices),
        object_triangles=np.asarray(ring.faces),
        solids=[] if measured else [block],
        measured=boxes if measured else None,
    )
    pieces = object_pieces(task.object_vertices, task.object_triangles)
    world = World.build(robot, task, pieces, solution, 0.003)
    found = world.sweep(np.repeat(q[None], 3, axis=0), np.zeros(3), np.inf, set(), TOLERANCES)
    assert any("object" in each for each in found) == meets


def test_capsules_of_a_robot_count():
    capsule = """<robot name="r"><link name="base"><collision><origin xyz="1 0 0" rpy="0 1.5708 0"/>
      <geometry><capsule radius="0.1" length="0.4"/></geometry></collision></link></robot>"""
    robot = RobotModel.read(capsule, "", {})
    shapes = robot.geometry.geometryObjects
    assert sorted(type(shape.geometry).__name__ for shape in shapes) == [
        "Cylinder",
        "Sphere",
        "Sphere",
    ]
    ends = sorted(shape.placement.translation[0] for shape in shapes)
    np.testing.assert_allclose(ends, (0.8, 1.0, 1.2), atol=1e-5)
