"""Subscriptions to cloud topics whose reliability follows the publishers.

Large best-effort clouds are lost between processes, and a reliable subscription hears nothing of a
best-effort publisher: so ask for reliable exactly where every publisher offers it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import PointCloud2

from placement_planner_ros.ros.paced import Paced
from placement_planner_ros.ros.timers import every

APART_S = 0.06
"""Between clouds, on average over the topics, at least: each takes the processor and the
interpreter from the search, which three at 10 Hz slowed by 27 % with 0.05."""
LATE_S = 1.0
"""Without a cloud, from which on a topic does not count; half of it between looks at what the
publishers offer. As long the first one is waited for before it is said that all is warm."""

OnCloud = Callable[[str, PointCloud2], None]


class CloudSubscriptions:
    """Subscribes to each topic and calls `on_cloud(topic, message)`.

    Args:
        group: of the subscriptions; without it, one of their own, in which clouds are `APART_S`.
    """

    def __init__(
        self,
        node: Node,
        topics: Sequence[str],
        on_cloud: OnCloud,
        group: CallbackGroup | None = None,
    ) -> None:
        self._node = node
        self._on_cloud = on_cloud
        self._group = group or Paced(self._period)
        self._heard: dict[str, float] = {}
        self._subscriptions: dict[str, tuple[ReliabilityPolicy, Subscription]] = {}
        # reliable until the publishers are known, as large clouds are lost by best effort
        for topic in topics:
            self._subscribe(topic, ReliabilityPolicy.RELIABLE)
        every(node, LATE_S / 2, self.follow)

    def follow(self) -> None:
        """Subscribe anew where the publishers offer something else than before."""
        for topic, (reliability, subscription) in list(self._subscriptions.items()):
            publishers = self._node.get_publishers_info_by_topic(subscription.topic_name)
            if not publishers:
                continue
            offered = {p.qos_profile.reliability for p in publishers}
            # a reliable subscription hears nothing of a publisher that offers best effort
            wanted = (
                ReliabilityPolicy.RELIABLE
                if offered == {ReliabilityPolicy.RELIABLE}
                else ReliabilityPolicy.BEST_EFFORT
            )
            # nobody can change a subscription, only make another
            if wanted is not reliability:
                self._node.destroy_subscription(subscription)
                self._subscribe(topic, wanted)

    def _period(self) -> float:
        """Seconds between two clouds of one topic."""
        late = time.monotonic() - LATE_S
        return APART_S * sum(heard > late for heard in list(self._heard.values()))

    def _subscribe(self, topic: str, reliability: ReliabilityPolicy) -> None:
        def received(message: PointCloud2) -> None:
            self._heard[topic] = time.monotonic()
            self._on_cloud(topic, message)

        profile = QoSProfile(depth=1, history=HistoryPolicy.KEEP_LAST, reliability=reliability)
        # What the publishers offer is followed, so nobody need be warned that it is something else.
        subscription = self._node.create_subscription(
            PointCloud2,
            topic,
            received,
            profile,
            callback_group=self._group,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        self._subscriptions[topic] = (reliability, subscription)
