"""What `ros2 param dump` writes of the node, `ros2 param load` and `--params-file` take."""

import xml.etree.ElementTree as ET

import pytest
import rclpy
import yaml
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from placement_planner_ros.ros.parameters.one_line import one_line
from placement_planner_ros.ros.parameters.parameter_node import ParameterNode
from placement_planner_ros.ros.parameters.server import ParameterServer
from placement_planner_ros.share import share_path

URDF = """<?xml version="1.0"?>
<robot name="post">
  <!-- one link: nothing more -->
  <link name="base"><visual name="a: b #c &amp; d"/>
  </link>
</robot>
"""
GIVEN = {
    "robot_description": URDF,
    "arms": ["left"],
    "left.tip_frame": "base",
    "left.grasps": [1e-17, -2.5, 0.0, 0.0, 0.0, 1e-17, 1.0],
    "sensor_frames": ["eye"],
    "sensor_poses.eye": [0.0, 1e-05, 1.0, 0.0, 0.0, 0.0, 1.0],
    "time_limit": 1e-05,
    "object.scale": 1e-3,
    "object.triangles": [0, 1, 2],
    "object.vertices": [0.0, 1e-09, 1.0],
    "seed": 2**62,
    "use_sim_time": False,
}


class Tools:
    """What `ros2 param` does with a node that nobody else spins."""

    def __init__(self, node):
        self.node = node
        self.client = AsyncParameterClient(node, node.get_name())
        assert self.client.wait_for_services(30.0)

    def wait(self, future):
        rclpy.spin_until_future_complete(self.node, future, timeout_sec=120.0)
        return future.result()

    def dump(self, path):
        names = sorted(self.wait(self.client.list_parameters()).result.names)
        values = self.wait(self.client.get_parameters(names)).values
        assert len(values) == len(names)
        tree = {}
        for name, value in zip(names, values, strict=True):
            *groups, last = name.split(".")
            inner = tree
            for group in groups:
                inner = inner.setdefault(group, {})
            inner[last] = parameter_value_to_python(value)
        path.write_text(yaml.dump({f"/{self.node.get_name()}": {"ros__parameters": tree}}))


@pytest.fixture
def node(ros):
    made = ParameterNode("dumped", [Parameter(n, value=v) for n, v in GIVEN.items()])
    yield made
    made.destroy_node()


def shown(server):
    return {name: server.current[name] for name in server.current.specs}


def test_a_dump_is_taken_while_the_node_runs_and_when_it_starts(node, tmp_path):
    server = ParameterServer(node)
    before, path = shown(server), tmp_path / "dump.yaml"
    mine = {name: value for name, value in GIVEN.items() if name in before}
    assert {name: before[name] for name in mine} == mine | {"robot_description": one_line(URDF)}
    tools = Tools(node)
    tools.dump(path)
    results = tools.wait(tools.client.load_parameter_file(str(path))).results
    assert len(results) > len(before)
    assert {each.reason for each in results} == {""}
    assert all(each.successful for each in results)
    result = tools.wait(tools.client.load_parameter_file_atomically(str(path))).result
    assert result.successful, result.reason
    assert shown(server) == before
    # The text as it was given is the same too.
    assert node.set_parameters([Parameter("robot_description", value=URDF)])[0].successful
    # And at start-up, where an empty list has no type.
    rclpy.shutdown()
    rclpy.init(args=["--ros-args", "--params-file", str(path)])
    again = ParameterNode("dumped")
    try:
        server = ParameterServer(again)
        assert shown(server) == before
        assert server.strange(again.given) == []
    finally:
        again.destroy_node()


def test_a_description_on_one_line_means_the_same():
    line = one_line(URDF)
    assert yaml.safe_load(line) == line
    before, after = ET.fromstring(URDF), ET.fromstring(line)
    assert [(e.tag, e.attrib) for e in after.iter()] == [(e.tag, e.attrib) for e in before.iter()]
    assert one_line(line) == line
    for text in ("", "/a/b.urdf", "package://a/b.urdf", "<robot", "<robot>&</robot>"):
        assert one_line(text) == text
    for name in ("yumi.urdf", "yumi.srdf"):
        line = one_line(share_path("urdf", name).read_text())
        assert yaml.safe_load(line) == line


def test_another_value_than_at_start_up_is_refused_one_that_is_read_only_too(node):
    ParameterServer(node)
    for name, value in (("robot_description", URDF.replace("base", "x")), ("sensor_frames", [])):
        result = node.set_parameters_atomically([Parameter(name, value=value)])
        assert not result.successful
        assert "start-up" in result.reason
    result = node.set_parameters_atomically(
        [Parameter("start_type_description_service", value=False)]
    )
    assert not result.successful
    assert not node.set_parameters_atomically([]).successful


def test_a_name_that_nobody_knows_is_told_with_the_nearest(node):
    server = ParameterServer(node)
    given = ["time_limt", "sensor_poses.ear", "right.tip_frame", "qos_overrides./x.y", "seed"]
    assert server.strange(given) == [
        "time_limt: there is no such parameter; the nearest is time_limit",
        "sensor_poses.ear: there is no such parameter, as sensor_frames did not name 'ear' at "
        "start-up",
        "right.tip_frame: there is no such parameter; the nearest is left.tip_frame. If 'right' is "
        "an arm, name it in arms at start-up",
    ]
    assert server.strange([f"name_{i}" for i in range(50)])[-1] == "and 30 more"
    tools = Tools(node)
    wrong = [Parameter("seed", value=3), Parameter("timelimit", value=3)]
    results = tools.wait(tools.client.set_parameters(wrong)).results
    assert [each.successful for each in results] == [True, False]
    assert "the nearest is time_limit" in results[1].reason
    result = tools.wait(tools.client.set_parameters_atomically(wrong)).result
    assert not result.successful
    assert "the nearest is time_limit" in result.reason
