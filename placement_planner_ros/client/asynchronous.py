"""The client for executives in asyncio."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Self, TypeVar

from geometry_msgs.msg import Pose

from placement_planner_ros.client.calls import Value
from placement_planner_ros.client.connection import Connection
from placement_planner_ros.client.session import Enough
from placement_planner_ros.client.solution import Solution
from placement_planner_ros.client.status import Status
from placement_planner_ros.client.waiting import Steps, finish_async

T = TypeVar("T")


class AsyncPlacementClient(Connection):
    """`PlacementClient` for asyncio: the same methods, to be awaited. Cancelling a task that awaits
    `place` stops the run. A node of the caller's must be spun in a thread.
    """

    async def wait_until_ready(self, seconds: float) -> Status:
        """See `PlacementClient.wait_until_ready`."""
        return await self._finish(self._conversation.until_ready(seconds))

    async def place(
        self,
        parameters: Mapping[str, Value] | None = None,
        deadline: float = 30.0,
        until: Enough | None = None,
    ) -> Solution:
        """See `PlacementClient.place`; `until` is called in the loop."""
        return await self._finish(self._conversation.place(parameters or {}, deadline, until))

    async def start(
        self, parameters: Mapping[str, Value] | None = None, patience: float = 0.0
    ) -> int:
        """See `PlacementClient.start`."""
        return await self._finish(self._conversation.start(parameters or {}, patience))

    async def stop(self, run: int) -> Solution:
        """See `PlacementClient.stop`."""
        return await self._finish(self._conversation.stop(run))

    async def confirm_placed(
        self, solution: Solution | None = None, pose: Pose | Sequence[float] | None = None
    ) -> int:
        """See `PlacementClient.confirm_placed`."""
        return await self._finish(self._conversation.confirm(solution, pose))

    async def remove_placed(self, placed: Solution | int) -> None:
        """See `PlacementClient.remove_placed`."""
        await self._finish(self._conversation.remove(placed))

    async def clear_environment(self) -> None:
        """See `PlacementClient.clear_environment`."""
        await self._finish(self._conversation.clear())

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self.close)

    async def _finish(self, steps: Steps[T]) -> T:
        return await finish_async(steps, self._conversation.news)
