"""What stands beside the robot, or beside what it holds, is not driven through."""

import coal
import numpy as np
import pinocchio as pin
import pytest
from helpers.fakes import TABLE
from helpers.snapshots import seen, yumi_snapshot

from placement_planner_ros.core.collision.attached_object import object_solids
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.timing.quintic import positions_at
from placement_planner_ros.ros.inputs.furniture import fixed_links
from placement_planner_ros.ros.inputs.known_surface import PlacedBody, surface_points
from placement_planner_ros.ros.run.preparation import make_planner
from placement_planner_ros.ros.run.surroundings import Surroundings
from placement_planner_ros.scenes.yumi import yumi_arm
from placement_planner_ros.share import PACKAGE, share_path

RADIUS = 0.002


@pytest.fixture(scope="module")
def holding():
    """The robot, the left hand holding the object, over a table; no cloud but that."""
    return yumi_snapshot(("left",), (TABLE,))


def pose_in_hand(snapshot, grasp=0):
    arm = snapshot.arms[0]
    return snapshot.robot.link_pose(snapshot.q_start, arm.tip_frame) * arm.grasps[grasp]


def rod_beside(snapshot, gap):
    """A rod on the table, as high as the object, `gap` beside it: its middle, its half length, and
    points all over it."""
    T = pose_in_hand(snapshot)
    corners = snapshot.body.vertices @ T.rotation.T + T.translation
    foremost = corners[np.argmax(corners[:, 0])]
    top = corners[:, 2].max() + 0.05
    middle = np.array([foremost[0] + gap + RADIUS, foremost[1], top / 2])
    turns = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    around = RADIUS * np.column_stack([np.cos(turns), np.sin(turns), np.zeros(8)])
    along = np.arange(0.004, top, 0.002)
    points = [middle * (1, 1, 0) + (0, 0, z) + around for z in along]
    return middle, top / 2, np.vstack(points)


def own_points(snapshot, deviation=0.0):
    """What a camera would see of the object in its first grasp."""
    points = surface_points(PlacedBody.at(snapshot.body, pose_in_hand(snapshot)).surface.corners)
    return points + np.random.default_rng(0).normal(0.0, deviation, points.shape)


def cuts(snapshot, placement, rod, T_rod):
    """Whether anything that moves, or the object, meets the rod on the way to the placement."""
    arm = next(a for a in snapshot.arms if a.name == placement.goal.arm)
    solids = object_solids(snapshot.body)
    curve = placement.trajectory
    for positions in positions_at(curve, np.linspace(0.0, curve.duration, 400)):
        q = snapshot.q_start.copy()
        q[arm.q_index] = positions
        T_object = snapshot.robot.link_pose(q, arm.tip_frame) * arm.grasps[placement.goal.grasp]
        things = [(solid.geometry, T_object) for solid in solids]
        shapes, poses = snapshot.robot.geometry.geometryObjects, snapshot.robot.geometry_poses(q)
        things += [(shape.geometry, T) for shape, T in zip(shapes, poses, strict=True)]
        for geometry, T in things:
            at, result = coal.Transform3s(T.rotation, T.translation), coal.CollisionResult()
            if coal.collide(geometry, at, rod, T_rod, coal.CollisionRequest(), result):
                return True
    return False


def found(snapshot, samples=1500):
    planner = make_planner(snapshot, Surroundings.of(snapshot).environment())
    return list(planner.run(lambda: planner.statistics.samples >= samples))


@pytest.mark.parametrize("gap", [0.003, 0.008])
@pytest.mark.parametrize("deviation", [0.0, 0.0005])
def test_a_rod_beside_the_held_object_is_not_cut(holding, gap, deviation):
    middle, half, points = rod_beside(holding, gap)
    points = np.vstack([TABLE, points, own_points(holding, deviation)])
    snapshot = seen(holding, clouds=(points,))
    rod, T_rod = coal.Capsule(RADIUS - 1e-4, 2 * half), coal.Transform3s(np.eye(3), middle)
    placements = found(snapshot)
    assert placements
    assert not any(cuts(snapshot, each, rod, T_rod) for each in placements)


def test_the_rod_is_in_the_way_of_some_placement_where_nobody_sees_it(holding):
    """Else the test above could not fail."""
    middle, half, _ = rod_beside(holding, 0.008)
    rod, T_rod = coal.Capsule(RADIUS - 1e-4, 2 * half), coal.Transform3s(np.eye(3), middle)
    changed = (holding.parameters.changed({"seed": seed}) for seed in range(10))
    others = (seen(holding, parameters=each) for each in changed)
    assert any(cuts(each, placed, rod, T_rod) for each in others for placed in found(each))


def test_what_is_held_in_one_grasp_is_an_obstacle_in_another(holding):
    turned = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.03])) * holding.arms[0].grasps[0]
    arm = yumi_arm(holding.robot, "left", [holding.arms[0].grasps[0], turned])
    points = own_points(holding)
    snapshot = seen(holding, arms=(arm,), clouds=(np.vstack([TABLE, points]),))
    environment = Surroundings.of(snapshot).environment()
    assert environment.obstacles_of("left", 0)[0] is environment.obstacles
    others = environment.near.of_grasps["left", 1]
    away = np.linalg.norm(points[:, None] - others[None], axis=2).min(axis=1)
    moved = points - pose_in_hand(snapshot, 1).translation  # those farthest from the other pose
    assert away[np.argmax(np.linalg.norm(moved, axis=1))] < 1e-6
    assert len(environment.obstacles_of("left", 1)[0]) >= len(environment.obstacles) + len(others)


FURNITURE = """<link name="table"><collision><origin xyz="0.4 0 -0.02"/>
<geometry><box size="0.4 0.6 0.04"/></geometry></collision></link>
<joint name="stands" type="fixed"><parent link="yumi_body"/><child link="table"/></joint></robot>"""


def test_furniture_of_the_description_carries_and_is_kept_clear_of(holding):
    urdf, srdf = (share_path("urdf", f"yumi.{kind}") for kind in ("urdf", "srdf"))
    robot = Robot.from_urdf(
        urdf.read_text().replace("</robot>", FURNITURE),
        package_dirs={PACKAGE: urdf.parent.parent},
        srdf=srdf.read_text(),
    )
    fixed = fixed_links(robot, ("gripper_l_base", "gripper_r_base"))
    assert (fixed.furniture, fixed.foot) == (("table",), ("yumi_body",))
    _, _, rod = rod_beside(holding, 0.1)
    clouds = (rod, fixed.surfaces[0].within(np.full(3, -2.0), np.full(3, 2.0)).points)
    arm = yumi_arm(fixed.robot, "left", holding.arms[0].grasps)
    snapshot = seen(
        holding,
        robot=fixed.robot,
        arms=(arm,),
        clouds=clouds,
        origins=(None, None),
        placed=(False, True),
    )
    placements = found(snapshot)
    assert placements
    lowest = (
        min(each.T_world_object.act(v)[2] for v in snapshot.body.vertices) for each in placements
    )
    assert np.abs(list(lowest)).max() < 1e-3
    table = coal.Box(0.4, 0.6, 0.038)
    T = coal.Transform3s(np.eye(3), np.array([0.4, 0.0, -0.021]))
    assert not any(cuts(snapshot, each, table, T) for each in placements)
