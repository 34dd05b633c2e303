"""Hours of malformed clouds and robot descriptions, by command; no part of `make test`.

    python test/by_hand fuzz_inputs clouds -max_total_time=300
    python test/by_hand fuzz_inputs robots -max_total_time=300

Needs atheris (`pip install atheris`). What follows the target goes to libFuzzer. It ends with an
error and the input that caused it where anything but the planner's own errors is raised.
"""

import math
import sys
import xml.etree.ElementTree as ET

try:
    import atheris
except ImportError:
    sys.exit("SKIPPED: nothing was tested, as atheris is not installed: pip install atheris")

with atheris.instrument_imports(include=["placement_planner_ros.core.robot"]):
    from placement_planner_ros.core.robot.model import Robot

with atheris.instrument_imports(include=["placement_planner_ros.ros.inputs"]):
    from placement_planner_ros.ros.inputs.cloud_store import CloudStore, StoredCloud
    from placement_planner_ros.ros.inputs.point_cloud import MAX_POINTS, points_from_message

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from placement_planner_ros.core.errors import CloudError, RobotError

URDF = """<robot name="r">
<link name="base"><collision><origin xyz="0 0 0.1" rpy="0 0 0"/><geometry>
<box size="0.1 0.2 0.3"/></geometry></collision></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0 0 1"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<link name="l1"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0"
izz="1"/></inertial><collision><geometry><cylinder radius="0.1" length="0.3"/></geometry>
</collision></link>
<joint name="j2" type="prismatic"><parent link="l1"/><child link="l2"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0.1" velocity="1" effort="1"/><mimic joint="j1" multiplier="2"/></joint>
<link name="l2"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="j3" type="continuous"><parent link="l1"/><child link="l3"/></joint>
<link name="l3"><collision><geometry><capsule radius="0.1" length="0.1"/></geometry></collision>
<collision><geometry><box size="1 1 1" filename="package://p/m.stl" scale="1 1 1"/></geometry>
</collision>
</link>
<joint name="j4" type="fixed"><parent link="l3"/><child link="l4"/></joint><link name="l4"/>
</robot>"""
SRDF = """<robot name="r"><group name="g"><joint name="j1"/></group>
<disable_collisions link1="base" link2="l1" reason="Adjacent"/>
<disable_collisions link1="l2" link2="l3"/></robot>"""
ODD = (
    *("", "0", "-1", "nan", "inf", "1e308", "-1e308", "1e-320", "1 2", "1 2 3", "0 0 0", "a b c"),
    *("nan 0 0", "1e200 1e200 1e200", "base", "l1", "l2", "universe", "j1", "j2", "r", "fixed"),
    *(
        "floating",
        "planar",
        "revolute",
        "continuous",
        "prismatic",
        "spherical",
        "\u00e4",
        "\U0001f600",
    ),
    *("/", "../..", "package://", "file:///dev/zero", "/dev/zero", "1" * 400, "0x10", "1_0", "٣"),
)
TAGS = ("link", "joint", "collision", "geometry", "mesh", "mimic", "limit", "robot", "axis", "x")
NAMES = ("x", "y", "z", "X", "", "xyz", "intensity", "x\0")
SIZES = (0, 1, 3, 4, 8, 12, 16, 17, 2**16, 2**31, 2**32 - 1)


def a_cloud(data):
    """A cloud whose parts fit one another more often than by chance."""

    def size():
        kind = data.ConsumeIntInRange(0, 3)
        if kind == 0:
            return data.PickValueInList(list(SIZES))
        return data.ConsumeIntInRange(0, 40)

    fields = [
        PointField(
            name=data.PickValueInList(list(NAMES)),
            offset=size(),
            datatype=data.ConsumeIntInRange(0, 10),
            count=data.PickValueInList([0, 1, 1, 1, 2, 2**32 - 1]),
        )
        for _ in range(data.ConsumeIntInRange(0, 5))
    ]
    if data.ConsumeBool():
        step = data.PickValueInList([4, 8])
        fields = [
            PointField(name=n, offset=i * step, datatype=step // 4 + 6, count=1)
            for i, n in enumerate("xyz")
        ] + fields
    message = PointCloud2(
        height=size(),
        width=size(),
        fields=fields,
        is_bigendian=data.ConsumeBool(),
        point_step=size(),
        row_step=size(),
        is_dense=data.ConsumeBool(),
    )
    message.data = data.ConsumeBytes(data.ConsumeIntInRange(0, 4000))
    if data.ConsumeBool() and message.width * message.height * message.point_step < 10**6:
        message.row_step = message.width * message.point_step
        message.data = bytes(message.data).ljust(message.height * message.row_step, b"\x40")
    return message


def clouds(data):
    """One malformed cloud."""
    message = a_cloud(atheris.FuzzedDataProvider(data))
    try:
        points = points_from_message(message)
    except CloudError:
        return
    assert points.shape[1:] == (3,)
    assert len(points) <= MAX_POINTS
    assert points.dtype == np.float64
    assert np.isfinite(points).all()
    store = CloudStore(["points"])
    store.add("points", StoredCloud(points, 0.0))
    store.merge(points, 0.01)


def with_odd_parts(data, description):
    """A description with a few parts exchanged, or any text."""
    if data.ConsumeIntInRange(0, 9) == 0:
        return data.ConsumeUnicode(2000)
    root = ET.fromstring(description)
    for _ in range(data.ConsumeIntInRange(1, 6)):
        everything = list(root.iter())
        one = data.PickValueInList(everything)
        act = data.ConsumeIntInRange(0, 5)
        if act <= 1 and one.attrib:
            name = data.PickValueInList(sorted(one.attrib))
            odd = data.ConsumeIntInRange(0, 4)
            odd = data.PickValueInList(list(ODD)) if odd else data.ConsumeUnicodeNoSurrogates(20)
            one.set(name, odd)
        elif act == 2 and one.attrib:
            del one.attrib[data.PickValueInList(sorted(one.attrib))]
        elif act == 3:
            other = data.PickValueInList(everything)
            if one not in list(other.iter()):
                one.append(other)
        elif act == 4 and len(one):
            one.remove(data.PickValueInList(list(one)))
        elif act == 5:
            one.tag = data.PickValueInList(list(TAGS))
    return ET.tostring(root, encoding="unicode")


def robots(data):
    """One malformed description."""
    provider = atheris.FuzzedDataProvider(data)
    srdf = with_odd_parts(provider, SRDF) if provider.ConsumeBool() else None
    text = with_odd_parts(provider, URDF)
    try:
        robot = Robot.from_urdf(text, srdf=srdf)
    except RobotError:
        return
    assert robot.model.nq == len(robot.joint_names)
    middle = np.clip(0.0, robot.lower, robot.upper)
    for link in (robot.root_link, robot.model.frames[-1].name):
        if robot.model.existFrame(link):
            assert math.isfinite(np.abs(robot.link_pose(middle, link).homogeneous).sum()), text


TARGETS = {"clouds": clouds, "robots": robots}


def main():
    if len(sys.argv) < 2 or sys.argv[1] not in TARGETS:
        sys.exit(__doc__)
    options = [sys.argv[0], "-len_control=0", "-max_len=4096", *sys.argv[2:]]
    atheris.Setup(options, TARGETS[sys.argv[1]])
    atheris.Fuzz()


if __name__ == "__main__":
    main()
