"""Clouds of cameras that see the robot and what it holds: neither becomes an obstacle."""

import numpy as np
import pinocchio as pin
import pytest

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.problem import workspace
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.ros.inputs.self_filter import outside_robot
from placement_planner_ros.scenes.clouds import DepthCamera, camera_clouds, scene_cameras
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.primitives import ConvexPrimitive
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import load_yumi, start_configuration, yumi_arm

PADDING = 0.02
SCENE = scene_by_name("table")


def robot_solids(robot, q):
    """The hull of each of the robot's geometries, where it stands."""
    data, placed = robot.model.createData(), robot.geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.geometry, placed, q)
    return [
        ConvexPrimitive(
            shape.name,
            np.array([T.act(shape.geometry.point(k)) for k in range(shape.geometry.num_points)]),
        )
        for T, shape in zip(placed.oMg, robot.geometry.geometryObjects, strict=True)
        if hasattr(shape.geometry, "num_points")
    ]


@pytest.fixture(scope="module", params=["large_crayons_box", "wine_glass"])
def seen(request):
    """Robot, arms, q_0, object and the points of three cameras, one of them facing the robot."""
    robot, held = load_yumi(), object_by_name(request.param)
    q = robot.configuration(start_configuration(held.name))
    arms = [yumi_arm(robot, name, grasps) for name, grasps in held.grasps.items()]
    in_hand = robot.link_pose(q, arms[0].tip_frame) * arms[0].grasps[0]
    extra = [
        *robot_solids(robot, q),
        *(
            ConvexPrimitive(part.name, part.vertices @ in_hand.rotation.T + in_hand.translation)
            for part in held.parts
        ),
    ]
    facing = DepthCamera.looking_at("camera_front_optical_frame", (1.1, 0.1, 0.9), (0.1, 0.0, 0.3))
    clouds = camera_clouds(
        SCENE, np.random.default_rng(0), extra=extra, cameras=(*scene_cameras(SCENE), facing)
    )
    body = Body.from_mesh(held.vertices, held.triangles, held.center_of_mass)
    return robot, arms, q, body, np.vstack([cloud.world_points() for cloud in clouds])


def environment_of(seen, padding):
    """With the robot left out, or with all points where `padding` is None."""
    robot, arms, q, body, points = seen
    if padding is not None:
        points = points[outside_robot(points, robot, q, arms, body, padding)]
    bounds = workspace(robot, tuple(arms), q, body, SCENE.volume)
    return Environment.from_points(points, SCENE.volume, bounds=bounds)


def test_the_start_is_free_and_nothing_stands_where_nothing_is(seen):
    robot, arms, q, body, points = seen
    left_out = ~outside_robot(points, robot, q, arms, body, PADDING)
    assert left_out.sum() > 10_000, "the robot is in view"
    obstacles = environment_of(seen, PADDING).obstacles
    for arm in arms:
        for grasp in range(len(arm.grasps)):
            collision = ArmCollision(
                MovingArm(robot, arm, q), AttachedObject(body, grasp), obstacles
            )
            assert collision.meeting(q[arm.q_index]) is None
    centers = (obstacles.lower + obstacles.upper) / 2
    depth = np.max([part.depth(centers) for part in SCENE.parts], axis=0)
    assert len(centers) > 1000
    assert depth.min() > -0.02, f"a phantom at {centers[depth.argmin()].round(3)}"


def test_without_the_filter_the_robot_stands_in_its_own_way(seen):
    robot, arms, q, body, _ = seen
    obstacles = environment_of(seen, None).obstacles
    for arm in arms:
        collision = ArmCollision(MovingArm(robot, arm, q), AttachedObject(body), obstacles)
        assert collision.meeting(q[arm.q_index]) is not None
