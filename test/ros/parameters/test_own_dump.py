"""What `ros2 param dump` writes of the node, `--params-file` takes."""

import pytest
import rclpy
import yaml
from rclpy.parameter import Parameter

from placement_planner_ros.ros.parameters.server import ParameterNode, ParameterServer

URDF = '<robot name="post">\n<!-- one link: nothing more --> <link name="a"/></robot>'
GIVEN = {
    "robot_description": URDF,
    "arms": ["left"],
    "left.tip_frame": "base",
    "left.grasps": [1e-17, -2.5, 0.0, 0.0, 0.0, 1e-17, 1.0],
    "sensor_frames": ["eye"],
    "sensor_poses.eye": [0.0, 1e-05, 1.0, 0.0, 0.0, 0.0, 1.0],
    "time_limit": 1e-05,
    "object.triangles": [0, 1, 2],
    "seed": 2**62,
    "use_sim_time": False,
}


@pytest.fixture
def node(ros):
    overrides = [Parameter(n, value=v) for n, v in GIVEN.items()]
    made = ParameterNode("dumped", overrides)
    yield made
    made.destroy_node()


def shown(server):
    return {name: server.current[name] for name in server.current.specs}


def test_a_dump_is_taken_at_start_up_where_an_empty_list_has_no_type(node, tmp_path):
    before, path, tree = shown(ParameterServer(node)), tmp_path / "dump.yaml", {}
    for name, parameter in node._parameters.items():
        *groups, last = name.split(".")
        inner = tree
        for group in groups:
            inner = inner.setdefault(group, {})
        inner[last] = (
            list(parameter.value)
            if name in before and isinstance(before[name], list)
            else parameter.value
        )
    path.write_text(yaml.dump({"/dumped": {"ros__parameters": tree}}))
    rclpy.shutdown()
    rclpy.init(args=["--ros-args", "--params-file", str(path)])
    again = ParameterNode("dumped")
    try:
        server = ParameterServer(again)
        assert shown(server) == before
        assert server.without_effect() == {}
    finally:
        again.destroy_node()
