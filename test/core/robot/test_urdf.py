"""The bundled YuMi against its measured figures, read by pinocchio alone."""

import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.share import share_path

URDF = share_path("urdf", "yumi.urdf")
ARM = (1, 2, 7, 3, 4, 5, 6)

# joint angles in degrees (order 1 2 7 3 4 5 6), position of the gripper base, quaternion x y z w
FORWARD = [
    (
        "l",
        (0, 0, 0, 0, 0, 0, 0),
        (0.56860, -0.00497, 0.41362),
        (-0.06774, 0.87516, -0.37552, 0.29748),
    ),
    (
        "r",
        (0, -130, -135, 30, 0, 40, 0),
        (-0.00980, -0.18241, 0.19704),
        (-0.84225, -0.11116, -0.52329, 0.06652),
    ),
    (
        "l",
        (-40, -60, 90, 20, 100, 45, -70),
        (0.29363, 0.37049, 0.19104),
        (0.39331, -0.90414, -0.10874, 0.12656),
    ),
    (
        "r",
        (70, -20, -50, -30, -120, 80, 150),
        (0.66379, -0.22439, 0.49937),
        (0.81106, 0.40472, 0.02733, 0.42146),
    ),
]


@pytest.fixture(scope="module")
def text() -> str:
    prefix = "package://placement_planner_ros"
    return URDF.read_text(encoding="utf-8").replace(prefix, str(URDF.parent.parent))


@pytest.fixture(scope="module")
def model(text: str) -> pin.Model:
    return pin.buildModelFromXML(text)


def configuration(model: pin.Model, positions: dict[str, float]) -> np.ndarray:
    q = pin.neutral(model)
    for name, value in positions.items():
        q[model.joints[model.getJointId(name)].idx_q] = value
    for side in "lr":
        master = model.joints[model.getJointId(f"gripper_{side}_joint")].idx_q
        q[model.joints[model.getJointId(f"gripper_{side}_joint_m")].idx_q] = q[master]
    return q


@pytest.mark.parametrize(("side", "degrees", "xyz", "xyzw"), FORWARD)
def test_forward_kinematics_table(model, side, degrees, xyz, xyzw):
    q = configuration(
        model, {f"yumi_joint_{n}_{side}": np.radians(d) for n, d in zip(ARM, degrees, strict=True)}
    )
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    T = data.oMf[model.getFrameId(f"gripper_{side}_base", pin.FrameType.BODY)]
    assert np.abs(T.translation - xyz).max() < 1e-4
    wanted = pin.Quaternion(np.array(xyzw))
    assert np.abs(T.rotation - wanted.normalized().matrix()).max() < 1e-4


def test_joint_order_and_limits(model):
    root = ET.parse(URDF).getroot()
    degrees = {
        1: (-168.5, 168.5, 180),
        2: (-143.5, 43.5, 180),
        7: (-168.5, 168.5, 180),
        3: (-123.5, 80, 180),
        4: (-290, 290, 400),
        5: (-88, 138, 400),
        6: (-229, 229, 400),
    }
    for side in "lr":
        names = [n for n in model.names if n.startswith("yumi_joint") and n.endswith(side)]
        assert names == [f"yumi_joint_{n}_{side}" for n in ARM]
        for n, wanted in degrees.items():
            limit = root.find(f"joint[@name='yumi_joint_{n}_{side}']/limit")
            stated = [float(limit.get(a)) for a in ("lower", "upper", "velocity")]
            assert np.degrees(stated) == pytest.approx(wanted, abs=1e-3)
        finger = root.find(f"joint[@name='gripper_{side}_joint']/limit")
        assert (finger.get("lower"), finger.get("upper")) == ("0", "0.025")
        mimic = root.find(f"joint[@name='gripper_{side}_joint_m']/mimic")
        assert mimic.get("joint") == f"gripper_{side}_joint"


def chain_of(links, kind="revolute", attributes=""):
    """A URDF of boxes on top of each other."""
    limit = '<axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
    shape = '<collision><geometry><box size=".02 .02 .02"/></geometry></collision>'
    return (
        f'<robot name="chain" {attributes}><link name="l0">{shape}</link>'
        + "".join(
            f'<link name="l{i}">{shape}</link><joint name="j{i}" type="{kind}">'
            f'<parent link="l{i - 1}"/><child link="l{i}"/><origin xyz="0 0 0.05"/>{limit}</joint>'
            for i in range(1, links)
        )
        + "</robot>"
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (chain_of(1002), r"1002 links.*1000"),
        (
            '<robot name="r"><link name="l">'
            + '<collision><geometry><sphere radius="1"/></geometry></collision>' * 1001
            + "</link></robot>",
            r"1001 collision shapes.*1000",
        ),
    ],
)
def test_more_than_can_be_planned_with_is_refused_with_its_number(text, words):
    with pytest.raises(RobotError, match=words):
        Robot.from_urdf(text)
