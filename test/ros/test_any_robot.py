"""A robot with a lift, an endless wrist and no SRDF: what the node makes of it, and says."""

import time

import numpy as np
import pytest
import yaml
from sensor_msgs.msg import JointState

CARRIED = {"lift": 0.1, "pan": 0.2, "swing": 0.3, "bend": 0.4, "roll": 17.3}


def part(name, size="0.05 0.05 0.1", at="0 0 0.1"):
    box = f'<origin xyz="{at}"/><geometry><box size="{size}"/></geometry>'
    return f'<link name="{name}"><collision>{box}</collision></link>'


def joint(name, parent, child, kind="revolute", at="0 0 0.25", axis="0 1 0", limits=(-1.5, 1.5)):
    low, high = limits
    range_ = "" if kind == "continuous" else f'lower="{low}" upper="{high}"'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/><axis xyz="{axis}"/>'
        f'<limit {range_} velocity="1" effort="1"/></joint>'
    )


URDF = "".join(
    [
        '<robot name="tower">',
        part("foot"),
        part("column"),
        part("head", at="0 0 0.3"),
        part("upper"),
        part("fore"),
        part("hand"),
        joint("lift", "foot", "column", "prismatic", axis="0 0 1", limits=(0, 0.3)),
        joint("pan", "column", "head", at="0 0 0.5", axis="0 0 1"),
        joint("swing", "column", "upper"),
        joint("bend", "upper", "fore", limits=(-3, 3)),
        joint("roll", "fore", "hand", "continuous", axis="0 0 1"),
        "</robot>",
    ]
)
GRASP = [0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0]


TOWER = {
    "robot_description": URDF,
    "arms": ["left"],
    "left.tip_frame": "hand",
    "left.grasps": GRASP,
    "left.gripper_joints": [],
    "left.gripper_open": [],
    "right.grasps": None,
}


def stand(b, **changes):
    """Stand there; a joint at None is told by nobody."""
    values = {name: value for name, value in (CARRIED | changes).items() if value is not None}

    def publish():
        b._joints.publish(
            JointState(name=list(values), position=[float(v) for v in values.values()])
        )

    inputs = b.node._inputs
    cloud = np.array([[x, y, -1.0] for x in np.arange(3.0, 3.4, 0.01) for y in (0.0, 0.01)])
    b.cloud(cloud, "foot")
    b.wait(lambda: inputs.clouds.updates > 0, again=lambda: b.cloud(cloud, "foot"))
    b.wait(lambda: inputs.joints.positions() == values, again=publish)
    publish()


def test_a_run_begins_from_any_number_of_turns_and_its_robot_may_wrap_them(bench):
    b = bench(**TOWER)
    stand(b)
    answer = b.call("start")
    assert answer.code == "OK", answer.text
    b.wait(lambda: b.snapshots)
    (snapshot,) = b.snapshots
    assert snapshot.q_start[snapshot.robot.index("roll")] == 17.3
    stand(b, roll=17.3 - 6 * np.pi)
    assert b.node._reporter.left_start(b.node._commands.run) == ""
    stand(b, roll=17.4 - 6 * np.pi)
    assert b.node._reporter.left_start(b.node._commands.run)


def test_a_lift_in_the_chain_is_told_with_the_way_to_leave_it_out(bench):
    b = bench(**TOWER)
    stand(b)
    words = b.call("start").words
    assert "arm left plans with lift, which moves pan too" in words
    assert "left.joints: [swing, bend, roll]" in words
    assert "acceleration limit 0.5 m/s^2 of lift" in words
    b.call("stop")
    alone = b.call("start_with", left__joints=["swing", "bend", "roll"])
    assert alone.code == "OK"
    assert "plans with" not in alone.words
    assert "acceleration limit" not in alone.words


@pytest.mark.parametrize("given", [{}, {"robot_description_semantic": '<robot name="tower"/>'}])
def test_links_that_overlap_where_the_robot_stands_are_told_with_the_line_to_add(bench, given):
    """The forearm lies along the column: their boxes overlap, the robot stands there."""
    b = bench(**TOWER, **given)
    stand(b, bend=3.0, swing=0.0)
    answer = b.call("start")
    assert answer.code == "BAD_START"
    assert '<disable_collisions link1="' in answer.text
    line = answer.text[answer.text.index("<disable_collisions") :].partition(" and ")[0]
    assert 'reason="User"/>' in line


def limits_of(b):
    b.node._inputs.robot.wait()
    robot = b.node._inputs.robot.robot
    return {
        name: (robot.velocity_limits[i], robot.acceleration_limits[i])
        for i, name in enumerate(robot.joint_names)
    }


LIMITS = {
    "lift": {"has_acceleration_limits": True, "max_acceleration": 0.2},
    "swing": {
        "has_velocity_limits": True,
        "max_velocity": 0.25,
        "has_acceleration_limits": False,
        "max_acceleration": 9.0,
    },
    "bend": {"max_velocity": 3, "max_acceleration": 2, "has_jerk_limits": False, "max_jerk": 1.0},
}


@pytest.mark.parametrize("kind", ["file", "parameters"])
def test_moveit_limits_are_read(bench, tmp_path, kind):
    """As its joint_limits.yaml, or as its launch files give them to a node."""
    if kind == "file":
        path = tmp_path / "joint_limits.yaml"
        path.write_text(
            yaml.safe_dump({"default_velocity_scaling_factor": 0.1, "joint_limits": LIMITS})
        )
        b = bench(**TOWER, robot_description_planning=str(path))
    else:
        b = bench(
            **TOWER,
            **{
                f"robot_description_planning.joint_limits.{joint}.{what}": value
                for joint, values in LIMITS.items()
                for what, value in values.items()
            },
        )
    found = limits_of(b)
    assert found["lift"] == (1.0, 0.2)
    assert found["swing"] == (0.25, 5.0)
    assert found["bend"] == (1.0, 2.0), "the URDF's velocity is the lower one"
    assert found["roll"] == (1.0, 5.0)


def test_without_a_description_the_robot_in_use_is_named(bench):
    b = bench()
    b.cloud()
    answer = b.call("start")
    assert "JOINTS_MISSING" in answer.text
    assert "YuMi" in answer.text
    assert "robot_description" in answer.text
    assert "yumi_joint_1_l" not in answer.text


def test_what_is_barely_beyond_a_limit_is_planned_from_there_and_told(bench):
    b = bench(**TOWER)
    stand(b, lift=-0.0008, pan=2.5)
    answer = b.call("start")
    assert answer.code == "OK", answer.text
    assert "lift = -0.0008 is 0.0008 beyond its limits [0, 0.3]: taken to be at" in answer.words
    assert "pan = 2.5 is 1 beyond" in answer.words, "of no arm, so no reason to refuse"
    b.wait(lambda: b.snapshots)
    (snapshot,) = b.snapshots
    assert snapshot.q_start[snapshot.robot.index("lift")] == 0.0
    assert b.node._reporter.left_start(b.node._commands.run) == ""
    b.call("stop")
    stand(b, lift=-0.04)
    b.wait(lambda: b.call("start").code == "BAD_START", again=lambda: stand(b, lift=-0.04))
    assert "lift = -0.04 is 0.04 beyond its limits" in b.call("start").words
    assert b.call("start_with", start_limit_tolerance=0.05).code == "OK"


def test_a_joint_that_nobody_publishes_may_be_told_instead(bench):
    b = bench(**TOWER)
    stand(b, pan=None)
    answer = b.call("start")
    assert answer.code == "JOINTS_MISSING"
    assert "pan" in answer.text
    assert b.call("start_with", assumed_joints=["pn=0.2"]).code == "BAD_PARAMETER"
    assert b.call("start_with", assumed_joints=["pan"]).code == "BAD_PARAMETER"
    assert b.call("start_with", assumed_joints=["pan=0.2"]).code == "OK"
    b.wait(lambda: b.snapshots)
    (snapshot,) = b.snapshots
    assert snapshot.q_start[snapshot.robot.index("pan")] == 0.2


def test_a_passive_joint_that_nobody_publishes_is_no_reason_to_refuse(bench):
    srdf = '<robot name="tower"><passive_joint name="pan"/></robot>'
    b = bench(**TOWER, robot_description_semantic=srdf)
    stand(b, pan=None)
    assert b.call("start").code == "OK"
    b.wait(lambda: b.snapshots)
    assert "pan" not in b.snapshots[0].joints


def move(b, joint, value):
    b.node._inputs.joints.update([joint], [value], time.monotonic(), time.time())


def test_only_what_an_arm_or_a_sensor_hangs_on_must_be_at_rest(bench):
    b = bench(**TOWER)
    stand(b)
    move(b, "pan", 0.3)
    answer = b.call("start")
    assert answer.code == "OK", answer.text
    assert "pan: moving, but of no arm and no sensor" in answer.words
    b.wait(lambda: b.snapshots)
    move(b, "pan", 0.5)
    assert b.node._reporter.left_start(b.node._commands.run) == ""
    b.call("stop")
    move(b, "pan", 0.6)
    move(b, "bend", 0.5)
    answer = b.call("start")
    assert answer.code == "ROBOT_MOVING"
    assert "bend" in answer.text
    assert "pan" not in answer.text
