"""The arm's collision checks against coal on every part and box; edges against dense samples."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from helpers.robots import mixed_robot, ring_in

from benchmarks.baselines.exact_collision import ExactCollision, compare
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import ArmCollision, CollisionSettings
from placement_planner_ros.core.collision.attached_object import AttachedObject, PlacedObject
from placement_planner_ros.core.collision.edges import bound_motion
from placement_planner_ros.core.collision.placing import place_joints, place_spheres
from placement_planner_ros.core.errors import JointStateError
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm

BOUNDS = np.array([[-1.0, -1.0, -1.0], [1.5, 1.0, 1.0]])


def plate(size, center, spacing=0.004):
    """Points on an axis-aligned box."""
    size, center = np.array(size), np.array(center)
    axes = [np.linspace(-s / 2, s / 2, max(2, int(s / spacing) + 2)) for s in size]
    points = np.array(np.meshgrid(*axes, indexing="ij")).reshape(3, -1).T
    on_face = (np.abs(np.abs(points) - size / 2) < 1e-12).any(axis=1)
    return points[on_face] + center


def obstacles_of(*clouds, cell=0.01):
    points = np.vstack(clouds) if clouds else np.zeros((0, 3))
    return ObstacleSet.from_points(points, GridSettings(cell_size=cell), bounds=BOUNDS)


def small_body(size=(0.04, 0.04, 0.04)):
    mesh = trimesh.creation.box(size)
    return Body.from_mesh(mesh.vertices, mesh.faces)


# ---- robots -------------------------------------------------------------------------------------

SLIDER = """
<robot name="slider">
  <link name="base"/>
  <link name="rail"/>
  <link name="ball"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>
  <joint name="x" type="prismatic"><parent link="base"/><child link="rail"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="2" velocity="1" effort="1"/></joint>
  <joint name="y" type="prismatic"><parent link="rail"/><child link="ball"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>
"""


@pytest.fixture(scope="module")
def ring_file(tmp_path_factory):
    return ring_in(tmp_path_factory.mktemp("meshes"))


@pytest.fixture(scope="module")
def mixed(ring_file):
    return mixed_robot(ring_file)


@pytest.fixture(scope="module")
def slider():
    return Robot.from_urdf(SLIDER)


@pytest.fixture(scope="module")
def yumi():
    return load_yumi()


def slider_checker(slider, obstacles, body=None, **kwargs):
    arm = slider.arm("arm", "ball", grasps=[pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.0405]))])
    load = None if body is None else AttachedObject(body)
    return ArmCollision(MovingArm(slider, arm, np.zeros(2)), load, obstacles, **kwargs)


# ---- scenes -------------------------------------------------------------------------------------


def yumi_setup(yumi, scene, thing, side):
    obj = object_by_name(thing)
    arm = yumi_arm(yumi, side, obj.grasps[side])
    start = dict(START_CONFIGURATION)
    start["gripper_l_joint"] = start["gripper_r_joint"] = obj.finger_opening
    q_rest = yumi.configuration(start)
    points = complete_cloud(scene_by_name(scene), spacing=0.008, bounds=BOUNDS * 0.9)
    body = Body.from_mesh(obj.vertices, obj.triangles, obj.center_of_mass)
    return MovingArm(yumi, arm, q_rest), AttachedObject(body), obstacles_of(points)


def mixed_setup(mixed):
    rng = np.random.default_rng(3)
    blocks = [
        plate(rng.uniform(0.01, 0.2, 3), rng.uniform([-0.6, -0.6, 0.0], [0.6, 0.6, 0.8]))
        for _ in range(14)
    ]
    grasp = pin.SE3(pin.utils.rotate("y", 0.4), np.array([0.06, 0.0, 0.01]))
    arm = replace(mixed.arm("arm", "tip", grasps=[grasp]), touch_links=("ring",))
    held = AttachedObject(small_body((0.03, 0.1, 0.05)))
    return MovingArm(mixed, arm, np.zeros(4)), held, obstacles_of(*blocks)


# ---- configurations -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scene", "thing", "side"),
    [("cabinet_high_clutter", "wine_glass", "left"), ("table", "toy_table", "right")],
)
def test_agrees_with_coal_on_the_yumi(yumi, scene, thing, side):
    setup = yumi_setup(yumi, scene, thing, side)
    settings = CollisionSettings()
    checker, reference = ArmCollision(*setup, settings), ExactCollision(*setup, settings)
    arm, q_start = setup[0].arm, setup[0].q
    rng = np.random.default_rng(11)
    Q = np.vstack(
        [
            rng.uniform(arm.lower, arm.upper, (60, arm.dof)),
            q_start + rng.normal(size=(60, arm.dof)) * 0.4,
        ]
    )
    expected = np.array([reference.free(q) for q in Q])
    assert 0.2 < expected.mean() < 0.9
    answers = compare(checker, reference, Q)
    assert (answers.free, answers.colliding) == (expected.sum(), (~expected).sum())
    assert not len(answers.disagreements)
    assert answers.ties == 0
    assert [checker.free(q) for q in Q[:40]] == expected[:40].tolist()
    assert [checker.meeting(q) is None for q in Q] == expected.tolist()


@pytest.mark.parametrize("self_margin", [0.0, 0.004])
def test_agrees_with_coal_on_every_kind_of_shape(mixed, self_margin):
    setup = mixed_setup(mixed)
    settings = CollisionSettings(collision_margin=0.005, self_margin=self_margin)
    checker, reference = ArmCollision(*setup, settings), ExactCollision(*setup, settings)
    arm = setup[0].arm
    Q = np.random.default_rng(5).uniform(arm.lower, arm.upper, (600, arm.dof))
    expected = np.array([reference.free(q) for q in Q])
    assert 0.1 < expected.mean() < 0.9
    assert (checker.free_batch(Q) == expected).all()


def test_where_the_hand_surely_collides_no_configuration_is_free(yumi):
    """Neither those the poses were made from nor others that reach them."""
    rng = np.random.default_rng(30)
    for scene, side in (("cabinet_high_clutter", "left"), ("table", "right")):
        setup = yumi_setup(yumi, scene, "toy_table", side)
        robot, arm, q_rest = setup[0].robot, setup[0].arm, setup[0].q_rest
        checker = ArmCollision(*setup)
        ik = InverseKinematics(Chain.from_robot(robot, arm, q_rest))
        Q = ik.chain.random(rng, (3000,))
        T = ik.chain.forward_batch(Q)
        sure = ~checker.hands_free(T, 1e-4, 0.001, contact=True)
        assert not checker.free_batch(Q[sure], 0.001, contact=True).any()
        assert sure.sum() > 100
        poses = T[sure][:40]
        solved = np.vstack([ik.solve(pose, ik.chain.random(rng, (32,))) for pose in poses])
        assert not checker.free_batch(solved, 0.001, contact=True).any()
        assert len(solved) > 5 * len(poses)


FLYING = """
<robot name="flying">
  <link name="base"/><link name="a"/><link name="b"/>
  <link name="thing"><collision><geometry>{shape}</geometry></collision></link>
  <joint name="x" type="prismatic"><parent link="base"/><child link="a"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="y" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="z" type="prismatic"><parent link="b"/><child link="thing"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>
"""


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(
    "shape", ['<sphere radius="0.02"/>', '<box size="0.04 0.04 0.04"/>'], ids=["ball", "box"]
)
def test_the_margin_is_kept_on_every_side(shape, axis, side):
    """From a plate at any place within its cell, whichever neighbouring cells that concerns."""
    robot = Robot.from_urdf(FLYING.format(shape=shape))
    moving = MovingArm(robot, robot.arm("arm", "thing"), np.zeros(3))
    for place in np.linspace(0.1, 0.11, 7):
        size, center = np.full(3, 0.3), np.zeros(3)
        size[axis], center[axis] = 0.0004, side * place
        plates = obstacles_of(plate(size, center))
        checker = ArmCollision(moving, None, plates)
        faces = plates.lower if side > 0 else -plates.upper
        touching = faces[:, axis].min() - 0.02 - 0.003
        for gap, free in ((2e-5, True), (-2e-5, False), (-0.002, False), (-0.01, False)):
            q = np.zeros(3)
            q[axis] = side * (touching - gap)
            assert checker.free(q) == free


def test_curved_shapes_count_as_the_polytopes_around_them(tmp_path):
    """Never free nearer than the margin, and free beyond what `ArmCollision.free` says it costs."""
    urdf = SLIDER.replace(
        '<sphere radius="0.02"/>', '<cylinder radius="0.2" length="0.1"/>'
    ).replace('xyz="0 1 0"', 'xyz="0 0 1"')
    robot = Robot.from_urdf(urdf)
    arm = robot.arm("arm", "ball")
    floor = obstacles_of(plate((0.8, 0.8, 0.02), (0.0, 0.0, -0.1), spacing=0.01))
    checker = ArmCollision(MovingArm(robot, arm, np.zeros(2)), None, floor)
    top = floor.upper[:, 2].max()
    assert not checker.free(np.array([0.0, top + 0.05 + 0.00299]))
    assert checker.free(np.array([0.0, top + 0.05 + 0.00301]))
    wall = obstacles_of(plate((0.02, 0.01, 0.3), (0.5, 0.0, 0.0)))
    checker = ArmCollision(MovingArm(robot, arm, np.zeros(2)), None, wall)
    face = wall.lower[:, 0].min()
    assert not checker.free(np.array([face - 0.2 - 0.00299, 0.0]))
    assert checker.free(np.array([face - 0.2 * 1.005 - 0.00301, 0.0]))
    close = np.array([face - 0.2 - 0.0031, 0.0])  # beside the rim, within the polygon around it
    assert not checker.free(close)
    assert str(checker.meeting(close)).startswith("ball meets an obstacle at (0.4")


def test_empty_environment_and_empty_hand(slider):
    checker = slider_checker(slider, obstacles_of())
    assert checker.free(np.zeros(2))
    assert checker.edge_free(np.array([-1.0, -1.0]), np.array([2.0, 1.0]))
    assert checker.free_batch(np.zeros((0, 2))).shape == (0,)


def where(said):
    return np.array([float(word) for word in said[said.index("(") + 1 : -1].split(",")])


def test_a_meeting_names_the_nearest_box_or_the_middle_of_what_meets(slider):
    wall = plate((0.002, 0.3, 0.3), (0.5, 0.0, 0.0))
    checker = slider_checker(
        slider, obstacles_of(wall, wall - np.array([0.3, 0.0, 0.0])), small_body()
    )
    for q in ((0.51, 0.1), (0.21, -0.1), (0.492, 0.033)):  # their middle is close to a wall
        said = str(checker.meeting(np.array(q), contact=True))
        assert said.startswith("ball meets an obstacle at (")
        assert np.abs(where(said) - [0.5 if q[0] > 0.4 else 0.2, q[1], 0.0]).max() < 0.011
    said = str(checker.meeting(np.array([0.477, 0.1])))
    assert said.startswith("the held object meets an obstacle at (")
    assert abs(where(said)[0] - 0.5) < 0.006
    assert (np.abs(where(said) - [0.5, 0.1, -0.0405]) < [0.01, 0.03, 0.03]).all()

    post = '<link name="base"><collision><origin xyz="1 0 0"/>'
    post += '<geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>'
    urdf = SLIDER.replace('<link name="base"/>', post)
    robot = Robot.from_urdf(urdf, srdf="<robot name='slider'/>")
    arm = replace(robot.arm("arm", "ball"), touch_links=())
    there = pin.SE3(pin.utils.rotate("z", 0.5 * np.pi), np.array([0.2, 0.1, 0.3]))
    checker = ArmCollision(
        MovingArm(robot, arm, np.zeros(2)),
        PlacedObject(small_body((0.2, 0.04, 0.04)), there),
        obstacles_of(),
    )
    arrays = [each for each in checker._flat.arrays if isinstance(each, np.ndarray)]
    assert all(each.flags.c_contiguous for each in arrays), "or kernels are compiled for it"
    said = str(checker.meeting(np.array([0.935, 0.03])))
    assert said.startswith("ball meets base at (")
    assert (np.abs(where(said) - [0.9525, 0.03, 0.0]) < [0.003, 0.02, 0.02]).all()
    assert checker.meeting(np.array([0.2, 0.1])) is None
    # Turned as it is, it reaches 0.02 along x and 0.1 along y.
    checker.place(pin.SE3(there.rotation, np.array([0.3, 0.1, 0.0])))
    said = str(checker.meeting(np.array([0.3399, 0.17])))
    assert said.startswith("ball meets the placed object at (")
    assert where(said)[0] == pytest.approx(0.32, abs=0.001)
    assert checker.meeting(np.array([0.3401, 0.17])) is None


def test_what_is_not_finite_or_of_the_wrong_length_is_refused(slider):
    checker = slider_checker(slider, obstacles_of())
    good, bad = np.zeros(2), np.array([0.0, np.nan])
    for ask in (
        lambda: checker.free(bad),
        lambda: checker.free_batch(np.array([good, bad])),
        lambda: checker.edge_free(good, bad),
        lambda: checker.edge_free(good, good, deviation=np.array([np.inf, 0.0])),
    ):
        with pytest.raises(JointStateError, match="finite"):
            ask()
    with pytest.raises(ValueError, match="reshape"):
        checker.edge_free(good, np.zeros(3))


# ---- the object in the hand ---------------------------------------------------------------------


def test_contact_leaves_out_the_object_against_its_support_only(slider):
    # The object hangs under the ball: its bottom is 0.0605 below the rail.
    floor = obstacles_of(plate((0.6, 0.6, 0.01), (0.0, 0.0, -0.0655)))
    checker = slider_checker(slider, floor, small_body())
    a, b = np.array([-0.1, 0.0]), np.array([0.1, 0.05])
    assert not checker.free(a)
    assert checker.free(a, contact=True)
    assert not checker.edge_free(a, b)
    assert checker.edge_free(a, b, contact=True)
    # Without the object, the hand itself must keep away.
    near = obstacles_of(plate((0.6, 0.6, 0.01), (0.0, 0.0, -0.027)))
    checker = slider_checker(slider, near, small_body())
    assert not checker.free(a, contact=True)
    assert not checker.edge_free(a, b, contact=True)


def test_placed_object_is_an_obstacle_to_all_but_the_touch_links(slider):
    there = pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.0]))
    touching = slider.arm("arm", "ball")
    arm = replace(touching, touch_links=())
    checker = ArmCollision(
        MovingArm(slider, arm, np.zeros(2)), PlacedObject(small_body(), there), obstacles_of()
    )
    assert "the placed object" in str(checker.meeting(np.array([0.48, 0.0])))
    assert checker.free(np.array([0.4, 0.0]))
    assert not checker.edge_free(np.array([0.4, 0.0]), np.array([0.6, 0.0]))
    checker = ArmCollision(
        MovingArm(slider, touching, np.zeros(2)), PlacedObject(small_body(), there), obstacles_of()
    )
    assert checker.free(np.array([0.48, 0.0]))


# ---- edges --------------------------------------------------------------------------------------


@pytest.mark.parametrize("thickness", [0.0, 0.002])
def test_nothing_thin_slips_between_the_samples(slider, thickness):
    rng = np.random.default_rng(4)
    obstacles = obstacles_of(plate((thickness, 0.4, 0.4), (0.5, 0.0, 0.0)))
    checker = slider_checker(slider, obstacles)
    for _ in range(60):
        a = np.array([0.46 - rng.exponential(0.3), rng.uniform(-0.15, 0.15)])
        b = np.array([0.54 + rng.exponential(0.3), rng.uniform(-0.15, 0.15)])
        assert checker.free(a)
        assert checker.free(b)
        assert not checker.edge_free(a, b)
        assert not checker.edge_free(b, a)


PLANAR = """
<robot name="planar">
  <link name="base"/>
  <link name="upper"/>
  <link name="ball"><collision><origin xyz="0.5 0 0"/>
    <geometry><sphere radius="0.001"/></geometry></collision></link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="j2" type="revolute"><parent link="upper"/><child link="ball"/><axis xyz="0 0 1"/>
    <origin xyz="0.8 0 0"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
</robot>
"""


@pytest.mark.parametrize("size", [0.02, 0.5])
def test_no_motion_is_larger_than_its_bound(yumi, mixed, size):
    """Of any point in the ball around a body, by pinocchio."""
    planar = Robot.from_urdf(PLANAR, srdf="<robot name='planar'/>")
    rng = np.random.default_rng(7)
    closest = 0.0
    setups = [
        (MovingArm(planar, planar.arm("arm", "ball"), np.zeros(2)), None, obstacles_of()),
        mixed_setup(mixed),
        yumi_setup(yumi, "table", "toy_table", "right"),
    ]
    for setup in setups:
        robot, arm = setup[0].robot, setup[0].arm
        checker = ArmCollision(*setup)
        arrays, scratch = checker._flat.arrays, checker._scratch
        names = [body.name for body in checker._flat.bodies[: arrays.moving]]
        data, q_robot = robot.model.createData(), np.array(setup[0].q_rest)
        tip = robot.frame_id(arm.tip_frame)

        def at(x, name, local, robot=robot, arm=arm, data=data, q_robot=q_robot, tip=tip):
            q_robot[arm.q_index] = x
            pin.framesForwardKinematics(robot.model, data, q_robot)
            frame = tip if name == "the held object" else robot.frame_id(name)
            return data.oMf[frame], data.oMf[frame].act(local)

        for _ in range(60):
            q = rng.uniform(arm.lower, arm.upper)
            delta = size * rng.random(arm.dof)
            place_joints(arrays, scratch, q)
            place_spheres(arrays, scratch, arrays.moving)
            bound = np.zeros((arrays.moving, arm.dof + 1))
            bound_motion(arrays, scratch, delta, bound)
            for body, name in enumerate(names):
                T, _ = at(q, name, np.zeros(3))
                x, y, z, radius = scratch.body_spheres[body]
                center = T.actInv(np.array([x, y, z]))
                for first in (0, arm.dof - 1):
                    for _ in range(4):
                        change = delta * rng.choice([-1.0, 1.0], arm.dof)
                        change[:first] = 0.0
                        outward = rng.normal(size=3)
                        point = center + radius * outward / np.linalg.norm(outward)
                        moved = at(q + change, name, point)[1] - at(q, name, point)[1]
                        way = float(np.linalg.norm(moved))
                        assert way <= bound[body, first] + 1e-9
                        closest = max(closest, way / max(bound[body, first], 1e-9))
    assert closest > 0.9


def between(a, b, count):
    return a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)


@pytest.mark.parametrize("length", [0.15, 1.0])
@pytest.mark.parametrize("robot", ["yumi", "mixed"])
def test_certified_edges_are_free_at_dense_samples(request, robot, length):
    whole = request.getfixturevalue(robot)
    setup = (
        yumi_setup(whole, "table", "toy_table", "right") if robot == "yumi" else mixed_setup(whole)
    )
    checker, oracle, arm = ArmCollision(*setup), ExactCollision(*setup), setup[0].arm
    rng = np.random.default_rng(6)
    Q = rng.uniform(arm.lower, arm.upper, (200, arm.dof))
    A = np.array([q for q in Q if oracle.free(q)][:24])
    B = A + rng.normal(size=A.shape) * length / np.sqrt(arm.dof)
    certified = np.array([checker.edge_free(a, b) for a, b in zip(A, B, strict=True)])
    sampled = np.array(
        [oracle.free_batch(between(a, b, 50)).all() for a, b in zip(A, B, strict=True)]
    )
    assert not (certified & ~sampled).any()
    assert certified.sum() >= 0.8 * sampled.sum()
    assert 0.05 < certified.mean() < 1.0


def test_strayed_motions_of_certified_edges_are_free(yumi):
    setup = yumi_setup(yumi, "cabinet_high_clutter", "wine_glass", "left")
    checker, oracle, arm = ArmCollision(*setup), ExactCollision(*setup), setup[0].arm
    rng = np.random.default_rng(9)
    Q = setup[0].q + rng.normal(size=(200, arm.dof)) * 0.3
    A = np.array([q for q in Q if oracle.free(q)][:20])
    B = A + rng.normal(size=A.shape) * 0.1
    deviation = np.full(arm.dof, 0.01)
    certified = 0
    for a, b in zip(A, B, strict=True):
        if checker.edge_free(a, b, deviation=deviation):
            certified += 1
            path = a + rng.random(30)[:, None] * (b - a)
            corners = rng.choice([-1.0, 1.0], size=path.shape)
            # coal is off by some µm, so that much less than the margins counts as kept
            assert all(oracle.free(q, beyond=-1e-5) for q in path + corners * deviation)
    assert certified >= 3
