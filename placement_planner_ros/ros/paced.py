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

    Where one subscription's callback takes so long that its next turn would come at once, the
    others have theirs first: the executor, which goes by the order in which they were made, would
    never come to them.

    Args:
        period: least seconds between two messages of one of them, asked for at each look.
    """

    def __init__(self, period: Callable[[], float]) -> None:
        super().__init__()
        self._period = period
        self._taken_at: weakref.WeakKeyDictionary[Subscription, float] = weakref.WeakKeyDictionary()
        self._took: weakref.WeakKeyDictionary[Subscription, float] = weakref.WeakKeyDictionary()

    def can_execute(self, entity: Subscription) -> bool:
        """Asked by the executor whether to look for a message."""
        taken_at = self._taken_at.get(entity, -math.inf)
        # after a callback that took long each of the others has as long before its next turn
        others = sum(known() is not None for known in self.entities)  # rclpy keeps those destroyed
        turn = others * self._took.get(entity, 0.0)
        due = time.monotonic() >= taken_at + max(self._period(), turn)
        return due and bool(super().can_execute(entity))

    def beginning_execution(self, entity: Subscription) -> bool:
        """Told by the executor that a message is taken."""
        begins = bool(super().beginning_execution(entity))
        # the period counts from a callback's beginning, whatever it takes
        if begins:
            self._taken_at[entity] = time.monotonic()
        return begins

    def ending_execution(self, entity: Subscription) -> None:
        """Told by the executor that its callback has ended."""
        self._took[entity] = time.monotonic() - self._taken_at[entity]
        super().ending_execution(entity)
