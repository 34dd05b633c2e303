"""Qualities of service that more than one publisher or subscription asks for."""

from rclpy.qos import DurabilityPolicy, QoSProfile


def latched(depth: int) -> QoSProfile:
    """That many of the newest messages, also for those who come later."""
    return QoSProfile(depth=depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)


LATCHED = latched(1)
"""The newest message, also for those who come later."""
