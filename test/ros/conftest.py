"""Nodes, with fake inputs and as processes, and their clients."""

import pytest
import rclpy
from helpers.fakes import COMPILED, Bench
from helpers.system import OBJECT, SCENE, Client, running_node, wait
from rclpy.parameter import Parameter

from placement_planner_ros.ros.tools.scene_publisher import ScenePublisher


@pytest.fixture
def ros():
    """A running rclpy."""
    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture
def bench(ros):
    """Makes nodes with fake inputs, and closes them."""
    made = []

    def make(**parameters):
        made.append(Bench(**parameters))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture(scope="module")
def ros_module():
    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture(scope="module")
def node(ros_module, tmp_path_factory):
    yield from running_node(tmp_path_factory.mktemp("node") / "node.log")


@pytest.fixture(scope="module")
def client(node):
    made = Client("client")
    wait(lambda: made.value("warm") == "true", timeout=COMPILED)
    yield made
    made.close()


@pytest.fixture(scope="module")
def scene(client):
    """The scene's sensors, publishing until the module's tests are over."""
    publisher = ScenePublisher([Parameter("name", value=SCENE), Parameter("object", value=OBJECT)])
    client.executor_.add_node(publisher)
    client.guests.append(publisher)
    yield publisher
    client.executor_.remove_node(publisher)
