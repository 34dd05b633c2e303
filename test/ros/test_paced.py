"""Clouds are taken from each topic alike, and no more of them than the search can do with."""

import pytest
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from placement_planner_ros.ros import paced
from placement_planner_ros.ros.inputs import cloud_subscriptions as module
from placement_planner_ros.ros.inputs.cloud_subscriptions import APART_S, CloudSubscriptions

TOPICS = ["front", "left", "right"]


@pytest.fixture
def clouds(ros, monkeypatch):
    """Subscriptions to three topics by name, who may take from one, and a clock."""
    now = [100.0]
    for each in (paced, module):
        monkeypatch.setattr(each.time, "monotonic", lambda: now[0])
    node = Node("hears_clouds")
    CloudSubscriptions(node, TOPICS, lambda topic, message: None)
    found = {s.topic_name.strip("/"): s for s in node.subscriptions}

    def take(topic, seconds=0.0):
        """Whether a cloud of that topic is taken now, and what that takes."""
        subscription = found[topic]
        group = subscription.callback_group
        if not (group.can_execute(subscription) and group.beginning_execution(subscription)):
            return False
        assert not any(group.can_execute(each) for each in found.values())  # one at a time
        subscription.callback(PointCloud2())
        now[0] += seconds
        group.ending_execution(subscription)
        return True

    yield take, now
    node.destroy_node()


@pytest.mark.parametrize("seconds", [0.5 * APART_S, 1.6 * APART_S, 4.0 * APART_S, 60.0 * APART_S])
def test_each_has_its_turn_however_long_a_cloud_takes(clouds, seconds):
    take, now = clouds
    taken = dict.fromkeys(TOPICS, 0)
    for _ in range(60):
        topic = next((each for each in TOPICS if take(each, seconds)), None)
        if topic is None:
            now[0] += APART_S / 50.0
        else:
            taken[topic] += 1
    assert min(taken.values()) >= 1
    assert max(taken.values()) <= min(taken.values()) + 1
