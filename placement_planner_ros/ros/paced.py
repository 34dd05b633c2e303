"""Hearing a topic no more often than is wanted."""

from __future__ import annotations

import math
import time
import weakref
from collections.abc import Callable

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.subscription import Subscription


class Paced(MutuallyExclusiveCallbackGroup):
    """A group of subscriptions, each taken from no more often than every so many seconds.

    A message that is not taken costs next to nothing: the middleware keeps the newest as it is,
    and nobody makes a Python message of it.

    Args:
        period: least seconds between two messages of one of them, asked for at each look.
    """

    def __init__(self, period: Callable[[], float]) -> None:
        super().__init__()
        self._period = period
        self._taken_at: weakref.WeakKeyDictionary[Subscription, float] = weakref.WeakKeyDictionary()

    def can_execute(self, entity: Subscription) -> bool:
        """Asked by the executor whether to look for a message."""
        taken_at = self._taken_at.get(entity, -math.inf)
        due = time.monotonic() >= taken_at + self._period()
        return due and bool(super().can_execute(entity))

    def beginning_execution(self, entity: Subscription) -> bool:
        """Told by the executor that a message is taken."""
        begins = bool(super().beginning_execution(entity))
        if begins:
            self._taken_at[entity] = time.monotonic()
        return begins
