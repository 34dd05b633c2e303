"""The client.

A run is started with a time limit of the deadline, so that it ends by itself where the client is
gone; else it is the client that ends it.
"""

from __future__ import annotations

import atexit
import math
import threading
import time
from collections.abc import Callable, Mapping
from typing import Self

from geometry_msgs.msg import Pose
from rclpy.node import Node

from placement_planner_ros.client.answer import Answer
from placement_planner_ros.client.conversation import ANSWER_WITHIN, Conversation, Value
from placement_planner_ros.client.errors import NO_ANSWER, PlacementError
from placement_planner_ros.client.own_node import OwnNode
from placement_planner_ros.client.solution import Solution
from placement_planner_ros.client.status import ROBOT_MOVED, STOPPING, Status, Validity

Enough = Callable[[Solution], bool | None]
"""Told of each improvement; true where it is good enough."""

_PASSING = frozenset({"NOT_READY", "ROBOT_MOVING", "STOPPING"})
"""Refusals that pass by themselves: something is being read, the robot comes to rest, the worker of
the run before ends."""

GONE_AFTER = 2.0
"""Seconds without the node's services after which it counts as gone."""


class PlacementClient:
    """Plans placements with the node `placement_planner`, and waits for the results.

    Safe to use from several threads. In a callback of `node` its methods may only be called where a
    `MultiThreadedExecutor` spins it and the callback is in a group of its own.

    Args:
        node: one of the caller's, that somebody spins; without it the client has one of its own.
        planner: name of the planning node, in the namespace of `node` unless it begins with `/`.
    """

    def __init__(self, node: Node | None = None, planner: str = "placement_planner") -> None:
        self._own = OwnNode() if node is None else None
        used = self._own.node if self._own is not None else node
        assert used is not None
        self._talk = Conversation(used, planner)
        self._hearing = self._talk.hearing
        self._placing = threading.RLock()
        if self._own is not None:  # whose thread, spinning as Python ends, would end it by a signal
            atexit.register(self.close)

    @property
    def status(self) -> Status | None:
        """The node's newest status; None before one has come."""
        return self._hearing.status

    def validity(self, solution: Solution) -> Validity:
        """Whether that solution can be carried out now. Look at it right before the robot moves.

        Not where a newer cloud cuts through its way, the robot has left the start, inputs have gone
        stale, robot or object were replaced, or another run has begun.
        """
        return self._hearing.validity(solution.run, solution.number)

    def improvement(self, run: int, number: int | None = None) -> Solution | None:
        """The best that the run has found so far, as far as it has come; for runs that `start`
        began.

        Args:
            number: that of an earlier one, counted from 1; it may have come and not be kept.
        """
        return self._hearing.solution(run, number)

    def wait_until_ready(self, seconds: float) -> Status:
        """The node's status, once it could begin a run at once: nothing is compiled or read any
        more, clouds and joint states arrive.

        Raises:
            PlacementError: not within that time: NO_NODE, or NOT_READY with what is lacking.
        """
        talk = self._talk

        def ready() -> Status | None:
            status = self.status
            could = status is not None and not status.lacking and talk.offered("start_with")
            return status if could else None

        found = talk.news.wait_until(ready, time.monotonic() + seconds)
        if found is not None:
            return found
        # in time it was not: no node, one that says nothing, or one that is not ready
        if not talk.offered("start_with"):
            raise talk.no_node("start_with")
        if self.status is None:
            raise PlacementError(NO_ANSWER, talk.unheard("its status has not come"))
        raise PlacementError("NOT_READY", self.status.lacking)

    def place(
        self,
        parameters: Mapping[str, Value] | None = None,
        deadline: float = 30.0,
        until: Enough | None = None,
    ) -> Solution:
        """Where and how to put down what the robot holds: the best found by the deadline.

        Refusals that pass by themselves are repeated until the deadline: NOT_READY while something
        is read, ROBOT_MOVING right after a motion, STOPPING while the run before ends. Where the
        robot leaves its start, planning begins again from where it then rests. However this is
        left, by an exception too, the run is stopped.

        Args:
            parameters: the node's, by name, for this run only.
            deadline: seconds from now on; `math.inf` for none. Then follows what stopping takes, a
                second at most.
            until: told of each improvement in this thread, as far as it comes in time; where it
                returns true the search ends. The solution that is returned may be a better one that
                came meanwhile.

        Returns:
            The run's best solution. It may not be valid any more: ask `validity` before moving.

        Raises:
            PlacementError: there is none, with the node's code and words, such as NO_CLOUD and
                BAD_VOLUME of a refused start, NO_SOLUTION and OUT_OF_REACH of a search.
            ValueError: the deadline is no time to come.
        """
        if isinstance(deadline, str | bool) or not deadline >= 0.0:
            remedy = "give seconds from now on, or math.inf for none"
            raise ValueError(f"deadline = {deadline!r}: {remedy}")
        # withdrawals count from here, so that one that comes at once is heeded
        end, withdrawals = time.monotonic() + deadline, self._talk.withdrawals
        # to the node 0 is no limit
        limit = deadline if math.isfinite(deadline) else 0.0
        given = {"time_limit": limit, **(parameters or {})}
        with self._placing:
            while True:
                run = self._begin(given, end, withdrawals)
                try:
                    self._search(run, end, until, withdrawals)
                except BaseException:
                    # whatever is raised, by the caller too, must not leave the run going
                    self._talk.leave(run)
                    raise
                try:
                    return self.stop(run)
                except PlacementError as error:
                    # else planning begins again from where the robot then rests
                    if error.code != "ROBOT_MOVED" or time.monotonic() >= end:
                        raise

    def start(self, parameters: Mapping[str, Value] | None = None, patience: float = 0.0) -> int:
        """Begin a run (`~/start_with`) and leave it running; its number.

        Args:
            parameters: for this run only; its `time_limit` is the node's unless it is among them.
            patience: seconds for which refusals that pass are repeated, as by `place`.

        Raises:
            PlacementError: it was refused.
        """
        end = time.monotonic() + patience
        return self._begin(parameters or {}, end, self._talk.withdrawals)

    def stop(self, run: int) -> Solution:
        """End that run (`~/stop_with`), if it has not ended yet; the best it has found.

        Raises:
            PlacementError: it has found nothing, or the robot has left its start, or the node's
                last run is another (WRONG_RUN).
        """
        talk = self._talk
        # the answer says what was found, the status how it ended
        answer = talk.ask("stop_with", {"run": run})
        if answer.code not in ("OK", "NOT_RUNNING", "STOPPING"):
            raise answer.error
        # the worker does not end in time, so its status goes no further than that
        hanging = answer.code == "STOPPING"

        def ended() -> Status | None:
            status = self.status
            if status is None or status.run != run:
                return None
            return status if status.ended or (hanging and status.state == STOPPING) else None

        status = talk.hear(ended, f"how run {run} ended is not known")
        # what was found begins where the robot is no more
        if status.state == ROBOT_MOVED:
            raise PlacementError("ROBOT_MOVED", answer.words, run)
        if status.solutions == 0:
            code = status.code if status.ended else answer.code
            raise PlacementError(code, answer.words, run)
        number = status.solutions
        # Its validity is as of when it is handed out, so that must be known first.
        end = time.monotonic() + ANSWER_WITHIN
        talk.news.wait_until(lambda: self._hearing.validity(run, number).known or None, end)
        lacking = f"solution {number} of run {run} has not come"
        return talk.hear(lambda: self._hearing.solution(run, number), lacking)

    def confirm_placed(self, solution: Solution, pose: Pose | None = None) -> int:
        """The object stands there now: it becomes obstacle and support (`~/confirm_placed_with`);
        the run's number.

        Args:
            solution: which one of the last run was carried out.
            pose: where the object was measured, in the planning frame.

        Raises:
            PlacementError: it was refused.
        """
        # with its run, so that no solution of another run with the same number is meant
        given: dict[str, Value] = {"run": solution.run, "solution": solution.number}
        if pose is not None:
            p, q = pose.position, pose.orientation
            given["pose"] = [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
        return self._command("confirm_placed_with", given).run or 0

    def remove_placed(self, placed: Solution | int) -> None:
        """The object that this solution, or run, placed has been taken away (`~/remove_placed`).

        Raises:
            PlacementError: nothing of that run stands (WRONG_RUN).
        """
        run = placed.run if isinstance(placed, Solution) else placed
        self._command("remove_placed", {"run": run})

    def clear_environment(self) -> None:
        """Forget accumulated points and all objects that were placed (`~/clear_environment`).

        Raises:
            PlacementError: it was refused.
        """
        self._command("clear_environment", {})

    def withdraw(self) -> None:
        """End every `place` that is under way, whose run is stopped: it raises `WITHDRAWN`.

        May be called from any thread, as by the cancel callback of an action server.
        """
        self._talk.withdraw()

    def close(self) -> None:
        """Withdraw, and let go of the node. Where the client has a node of its own this is done as
        Python ends, too.
        """
        atexit.unregister(self.close)
        if self._talk.closed:
            return
        # whoever waits in `place` leaves first, and stops its run
        self.withdraw()
        self._placing.acquire(timeout=ANSWER_WITHIN)
        self._talk.close()
        if self._own is not None:
            self._own.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _begin(self, parameters: Mapping[str, Value], end: float, withdrawals: int) -> int:
        """The run's number, once a start was accepted."""
        answer = self._talk.repeat("start_with", parameters, _PASSING, end, withdrawals)
        assert answer.run is not None
        return answer.run

    def _search(self, run: int, end: float, until: Enough | None, withdrawals: int) -> None:
        """Wait until the run has ended, or has found enough, or the time has come."""
        talk, told, gone_since = self._talk, 0, math.inf
        while True:
            # before the look, so that nothing that comes during it is slept over
            count = talk.news.count
            talk.heed(withdrawals, run)
            best = None if until is None else self._hearing.solution(run)
            # several may have come since the last look
            for number in range(told + 1, 1 + (0 if best is None else best.number)):
                told, better = number, self._hearing.solution(run, number)
                if until is not None and better is not None and until(better):
                    return
            # the run has ended, or another has begun, which stop will say, or the time is up
            now, status = time.monotonic(), self.status
            if status is not None and (status.run > run or (status.run == run and status.ended)):
                return
            if now >= end:
                return
            # the node counts as gone once its services have been missing for a while
            gone_since = math.inf if talk.offered("stop_with") else min(gone_since, now)
            if now >= gone_since + GONE_AFTER:
                raise talk.no_node("stop_with", run)
            talk.news.wait(count, end)

    def _command(self, name: str, parameters: Mapping[str, Value]) -> Answer:
        """The answer to what needs an idle planner, once it is.

        Raises:
            PlacementError: it was refused.
        """
        end, passing = time.monotonic() + ANSWER_WITHIN, frozenset({"STOPPING"})
        return self._talk.repeat(name, parameters, passing, end, self._talk.withdrawals)
