"""Finding out that there is another node of the same name."""

from __future__ import annotations

from rclpy.node import Node

from placement_planner_ros.ros.log import Log
from placement_planner_ros.ros.timers import every

_LOOK = 5.0
"""Seconds between looks."""
_LOOKS = 7
"""Looks in a row that must see it: a node that was killed is still seen for some 20 s."""


class Namesakes:
    """Warns where another node has this one's name: calls then reach the one or the other, and
    what both publish is mixed up. Nothing in ROS forbids it, as where one was left running.
    """

    def __init__(self, node: Node, log: Log) -> None:
        self._node = node
        self._log = log
        self._seen = 0
        every(node, _LOOK, self.look)

    def look(self) -> None:
        """Count them, and warn once where they stay."""
        mine = self._node.get_name(), self._node.get_namespace()
        there = self._node.get_node_names_and_namespaces().count(mine)
        self._seen = self._seen + 1 if there > 1 else 0
        if self._seen == _LOOKS:
            self._log.warn(
                f"another node is called {self._node.get_fully_qualified_name()}, too: calls reach "
                "the one or the other; end one of them, or give it another name (-r __node:=NAME)"
            )
