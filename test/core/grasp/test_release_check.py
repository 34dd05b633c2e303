"""A hand that closes around the object and cannot leave it, however far it opens."""

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.errors import GraspError
from placement_planner_ros.core.grasp.hand_opening import opening_error
from placement_planner_ros.core.grasp.open_hand import OpenHand
from placement_planner_ros.core.grasp.settings import GraspSettings, RetreatSettings
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet

NOTHING = ObstacleSet.from_points(np.zeros((0, 3)), GridSettings(), (np.zeros(3), np.ones(3)))
SIDES = {"palm": (0, 0, -1), "front": (0, 0, 1), "left": (0, 1, 0), "right": (0, -1, 0),
         "inner": (-1, 0, 0), "outer": (1, 0, 0)}  # fmt: skip


def cage(*without):
    """A hand of six plates around a cube of 4 cm, each 3 mm from it; the outer one slides."""
    links = ""
    for name, normal in SIDES.items():
        if name in (*without, "outer"):
            continue
        size = " ".join("0.004" if n else "0.05" for n in normal)
        at = " ".join(f"{0.025 * n + (0.05 if i == 2 else 0.0)}" for i, n in enumerate(normal))
        links += f'<collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry>'
        links += "</collision>"
    return Robot.from_urdf(
        f'<robot name="cage"><link name="base"/><link name="hand">{links}</link>'
        '<joint name="lift" type="prismatic"><parent link="base"/><child link="hand"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        '<link name="finger"><collision><origin xyz="0.025 0 0.05"/><geometry>'
        '<box size="0.004 0.05 0.05"/></geometry></collision></link>'
        '<joint name="slide" type="prismatic"><parent link="hand"/><child link="finger"/>'
        '<axis xyz="1 0 0"/><limit lower="0" upper="0.3" velocity="1" effort="1"/></joint></robot>'
    )


def let_go(robot, opened=0.02, settings=None, grasp=None):
    box = trimesh.creation.box((0.04, 0.04, 0.04))
    arm = robot.arm(
        "arm",
        "hand",
        grasps=[grasp or pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.05]))],
        gripper_joints=["slide"],
        gripper_open=[opened],
    )
    moving = MovingArm(robot, arm, robot.configuration({"lift": 0.3, "slide": 0.0}))
    held = AttachedObject(Body.from_mesh(box.vertices, box.faces))
    hand = OpenHand(
        moving, held.body, NOTHING, GraspSettings(retreat=settings or RetreatSettings())
    )
    error = opening_error(moving, held) or hand.leaving_error(0)
    if error is not None:
        raise error


def test_a_hand_around_the_object_is_refused_with_what_meets_it_where():
    with pytest.raises(GraspError) as caught:
        let_go(cage())
    said = str(caught.value)
    assert "arm.grasps[0] = [0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 1.0]" in said
    assert "none of the 16 directions" in said
    # 3 mm to the plates; the finger has opened by 20 mm.
    assert "along (0, 0, -1) in the tip frame, where hand is nearer after 0.003 m" in said
    assert (
        "the furthest along (-1, 0, 0) in the tip frame, where finger is nearer after 0.0" in said
    )
    assert "gripper_open" in said


@pytest.mark.parametrize("missing", ["front", "left", "right", "inner"])
def test_one_way_off_is_enough(missing):
    let_go(cage(missing))


def test_a_finger_that_opens_far_enough_is_no_hindrance():
    let_go(cage(), opened=0.15)  # the way off is over before it gets there


def test_straight_up_counts_for_each_side_that_the_object_can_stand_on():
    upwards = RetreatSettings(tip_directions=(), world_directions=((0.0, 0.0, 1.0),))
    let_go(cage("palm"), settings=upwards)
    with pytest.raises(GraspError, match="none of the 6 directions"):
        let_go(cage(), settings=upwards)


@pytest.mark.parametrize("depth", [0.0, 0.0027, 0.0029, 0.0032])
def test_what_the_search_could_not_bring_off_in_time_is_refused(depth):
    """A cup that lies in the object: planning asks for 0.2 mm of room after 3 mm of the way."""
    robot = cage("front", "left", "right", "inner")  # the palm is left, whose face is at 27 mm
    grasp = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.047 - depth]))
    if depth < 0.0028:
        let_go(robot, grasp=grasp)
    else:
        with pytest.raises(GraspError, match="where hand is nearer after 0\\.003 m"):
            let_go(robot, grasp=grasp)


@pytest.mark.parametrize(("opened", "fits"), [(0.0003, False), (0.0015, True)])
def test_fingers_that_hardly_open_are_told(opened, fits):
    """One plate 0.1 mm beside the object, along which the hand would draw back."""
    robot = cage("front", "left", "right")
    grasp = pin.SE3(np.eye(3), np.array([-0.0015 if fits else -0.0029, 0.0, 0.05]))
    if fits:
        let_go(robot, opened, grasp=grasp)
    else:
        with pytest.raises(
            GraspError, match="none of the 16 directions that are tried, 0\\.0002 m"
        ):
            let_go(robot, opened, grasp=grasp)
