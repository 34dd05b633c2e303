"""The steps of a client's session: calls to the node, and waiting for its answers.

A run is started with a time limit of the deadline, so that it ends by itself where the client is
gone; else it is the client that ends it. A run that was left, by an exception or because nobody
waits any more, is stopped.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence

from geometry_msgs.msg import Pose
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.task import Future

from placement_planner_ros.client.answer import Answer
from placement_planner_ros.client.calls import Calls, Value
from placement_planner_ros.client.errors import NO_ANSWER, NO_NODE, WITHDRAWN, PlacementError
from placement_planner_ros.client.solution import Solution
from placement_planner_ros.client.status import ROBOT_MOVED, SEARCHING, STOPPING, Status
from placement_planner_ros.client.subscriptions import Subscriptions
from placement_planner_ros.client.waiting import News, Steps, T, wait_until

Enough = Callable[[Solution], bool | None]
"""Told of each improvement; true where it is good enough."""

PASSING = frozenset({"NOT_READY", "ROBOT_MOVING", "STOPPING"})
"""Refusals that pass by themselves: something is being read, the robot comes to rest, the worker of
the run before ends."""

ANSWER_WITHIN = 10.0
"""Seconds within which an answer must come. The node's own take 0.1 s, stop's a second; where the
middleware has lost one it is sent again after some."""

RETRIED_AFTER = 0.1
"""Seconds after a refusal that passes."""

GONE_AFTER = 2.0
"""Seconds without the node's services after which it counts as gone."""

SILENT_FOR = 10.0
"""Seconds without a status, of which a node that searches sends two a second, after which it
counts as dead: its services are seen for longer than that where it was killed."""

LEFT_WITHIN = ANSWER_WITHIN
"""Seconds within which a run that is left must be known to be stopped; after that it is stopped as
soon as that can be said."""

KNOWN_WITHIN = 2.0
"""Seconds that the end of a run waits until the node has held its best solution against the newest
clouds, which takes it some 0.1 s."""

_NOT_SENT = (rclpy_implementation.InvalidHandle, rclpy_implementation.RCLError)
"""Raised where ROS has been shut down."""


class Session:
    """A client's part, whoever takes the steps.

    Args:
        planner: the planning node's name.
    """

    def __init__(self, node: Node, planner: str) -> None:
        group = ReentrantCallbackGroup()
        self.news = News()
        self.hearing = Subscriptions(node, planner, group, self.news)
        self._calls = Calls(node, planner, group, self.news)
        self._node = node
        self._owed: set[Future] = set()
        self._under_way = 0
        self._withdrawals = 0
        self._closed = False

    def close(self) -> None:
        """Neither call nor listen any more."""
        self._closed = True
        self._calls.close()
        self.hearing.close()

    def withdraw(self) -> None:
        """End every `place` that is under way; may be called from any thread."""
        self._withdrawals += 1
        self.news.tell()

    def until_ready(self, seconds: float) -> Steps[Status]:
        """See `PlacementClient.wait_until_ready`."""
        end = time.monotonic() + seconds
        while True:
            self._require_open()
            status = None if self._silent() else self.hearing.status
            offered = self._calls.offered("start_with")
            if offered and status is not None and status.ready:
                return status
            if time.monotonic() >= end:
                if not offered:
                    raise self._no_node("start_with")
                if status is None:
                    raise PlacementError(NO_ANSWER, self._unheard("its status has not come"))
                raise PlacementError("NOT_READY", status.lacking)
            yield end

    def place(
        self, parameters: Mapping[str, Value], deadline: float, until: Enough | None
    ) -> Steps[Solution]:
        """See `PlacementClient.place`."""
        self._under_way += 1
        try:
            return (yield from self._place(parameters, deadline, until))
        finally:
            self._under_way -= 1
            self.news.tell()

    def start(self, parameters: Mapping[str, Value], patience: float) -> Steps[int]:
        """See `PlacementClient.start`."""
        return (yield from self._begin(parameters, time.monotonic() + patience, self._withdrawals))

    def stop(self, run: int) -> Steps[Solution]:
        """See `PlacementClient.stop`."""
        answer = yield from self._ask("stop_with", {"run": run})
        if answer.code not in ("OK", "NOT_RUNNING", "STOPPING"):
            raise answer.error
        hanging = answer.code == "STOPPING"

        def ended() -> Status | None:
            status = self.hearing.status_of(run)
            if status is None or not (status.ended or (hanging and status.state == STOPPING)):
                return None
            return status

        status = yield from self._hear(ended, f"how run {run} ended is not known")
        if status.state == ROBOT_MOVED:
            raise PlacementError("ROBOT_MOVED", answer.words, run)
        if status.solutions == 0:
            code = status.code if status.ended else answer.code
            raise PlacementError(code, answer.words, run)
        number = status.solutions
        lacking = f"solution {number} of run {run} has not come"
        yield from self._hear(lambda: self.hearing.solution(run, number), lacking)
        # Its validity is as of when it is handed out, so that must be known first.
        end = time.monotonic() + KNOWN_WITHIN
        yield from wait_until(lambda: self.hearing.validity(run, number).known or None, end)
        return (yield from self._hear(lambda: self.hearing.solution(run, number), lacking))

    def confirm(self, solution: Solution | None, pose: Pose | Sequence[float] | None) -> Steps[int]:
        """See `PlacementClient.confirm_placed`."""
        if solution is None:
            if pose is not None:
                raise ValueError("pose: say which solution stands there, too")
            answer = yield from self._command("confirm_placed", {})
        else:
            given: dict[str, Value] = {"run": solution.run, "solution": solution.number}
            if pose is not None:
                given["pose"] = _seven_numbers(pose)
            answer = yield from self._command("confirm_placed_with", given)
        return answer.run or 0

    def remove(self, placed: Solution | int) -> Steps[None]:
        """See `PlacementClient.remove_placed`."""
        run = placed.run if isinstance(placed, Solution) else placed
        yield from self._command("remove_placed", {"run": run})

    def clear(self) -> Steps[None]:
        """See `PlacementClient.clear_environment`."""
        yield from self._command("clear_environment", {})

    def settle(self) -> Steps[None]:
        """Until nobody searches any more and the runs that were left are known to be stopped."""

        def settled() -> bool | None:
            owed = self._owed and self._calls.offered("stop_with")
            return not (self._under_way or owed) or None

        yield from wait_until(settled, time.monotonic() + ANSWER_WITHIN)

    # --- one run

    def _place(
        self, parameters: Mapping[str, Value], deadline: float, until: Enough | None
    ) -> Steps[Solution]:
        if isinstance(deadline, str | bool) or not deadline >= 0.0:
            remedy = "give seconds from now on, or math.inf for none"
            raise ValueError(f"deadline = {deadline!r}: {remedy}")
        end, withdrawals = time.monotonic() + deadline, self._withdrawals
        limit = deadline if math.isfinite(deadline) else 0.0
        while True:
            given = {"time_limit": limit, **parameters}
            run = yield from self._begin(given, end, withdrawals)
            try:
                yield from self._search(run, end, until, withdrawals)
            except BaseException as error:
                dead = isinstance(error, PlacementError) and error.code == NO_ANSWER
                yield from self._leave(run, dead or isinstance(error, GeneratorExit))
                raise
            try:
                return (yield from self.stop(run))
            except PlacementError as error:
                if error.code != "ROBOT_MOVED" or time.monotonic() >= end:
                    raise

    def _begin(self, parameters: Mapping[str, Value], end: float, withdrawals: int) -> Steps[int]:
        """The run's number, once a start was accepted."""
        answer = yield from self._repeat("start_with", parameters, PASSING, end, withdrawals)
        assert answer.run is not None
        return answer.run

    def _search(self, run: int, end: float, until: Enough | None, withdrawals: int) -> Steps[None]:
        """Until the run has ended, or has found enough, or the time has come."""
        told, heard_of, gone_since = 0, False, math.inf
        while True:
            self._heed(withdrawals, run)
            best = self.hearing.newest(run)
            if until is not None and best is not None and best.number > told:
                told = best.number
                if until(best):
                    return
            now, status = time.monotonic(), self.hearing.status
            of_run = status is not None and status.run == run
            heard_of = heard_of or of_run
            if status is not None and (status.ended if of_run else heard_of):
                return  # or the node's last run is another by now, which stop will say
            if now >= end:
                return
            gone_since = math.inf if self._calls.offered("stop_with") else min(gone_since, now)
            if now >= gone_since + GONE_AFTER:
                raise self._no_node("stop_with", run)
            if of_run and self._silent():
                words = self._unheard(f"no status of run {run} has come", SILENT_FOR)
                raise PlacementError(NO_ANSWER, words, run)
            yield end

    def _heed(self, withdrawals: int, run: int | None = None) -> None:
        if self._withdrawals != withdrawals:
            raise PlacementError(WITHDRAWN, "the client was told to withdraw", run)

    def _leave(self, run: int, at_once: bool) -> Steps[None]:
        """Stop a run that nobody waits for any more."""
        try:
            stopped = self._calls.send("stop_with", {"run": run})
        except _NOT_SENT:
            return  # it ends at its time limit
        self._owe(stopped)
        if not at_once:
            yield from self._attend(stopped)

    def _attend(self, answer: Future) -> Steps[None]:
        """Until it has come, or will hardly come any more."""
        yield from wait_until(
            lambda: answer.done() or not self._calls.offered("stop_with") or None,
            time.monotonic() + LEFT_WITHIN,
        )

    def _owe(self, future: Future) -> None:
        """Have `settle` wait for that answer."""
        self._owed.add(future)
        future.add_done_callback(self._owed.discard)

    def _leave_beginning(self, started: Future, at_once: bool) -> Steps[None]:
        """Stop a run that nobody waits for any more, once it is known whether it has begun."""
        if not at_once:
            yield from self._attend(started)
        if at_once or not started.done():
            self._owe(started)
            started.add_done_callback(self._leave_begun)
        elif (run := _begun_run(started)) is not None:
            yield from self._leave(run, at_once=False)

    def _leave_begun(self, started: Future) -> None:
        run = _begun_run(started)
        if run is not None:
            for _ in self._leave(run, at_once=True):
                pass

    # --- asking and hearing

    def _require_open(self) -> None:
        if self._closed:
            raise PlacementError(WITHDRAWN, "this client is closed; make another one")

    def _command(self, name: str, parameters: Mapping[str, Value]) -> Steps[Answer]:
        """The answer to what needs an idle planner, once it is.

        Raises:
            PlacementError: it was refused.
        """
        end = time.monotonic() + ANSWER_WITHIN
        return self._repeat(name, parameters, frozenset({"STOPPING"}), end, self._withdrawals)

    def _repeat(
        self,
        name: str,
        parameters: Mapping[str, Value],
        passing: frozenset[str],
        end: float,
        withdrawals: int,
    ) -> Steps[Answer]:
        """The answer, asked for again while it is a refusal that passes.

        Raises:
            PlacementError: it was refused.
        """
        while True:
            self._heed(withdrawals)
            answer = yield from self._ask(name, parameters, end)
            if answer.success:
                return answer
            again = time.monotonic() + RETRIED_AFTER
            if answer.code not in passing or again > end:
                raise answer.error
            yield from wait_until(lambda: None, again)

    def _ask(
        self, name: str, parameters: Mapping[str, Value], end: float | None = None
    ) -> Steps[Answer]:
        """The answer to one request, whatever it is.

        Args:
            end: until when the node is waited for where it is not there.
        """
        self._require_open()
        end = time.monotonic() + ANSWER_WITHIN if end is None else end
        if (yield from wait_until(lambda: self._calls.offered(name) or None, end)) is None:
            raise self._no_node(name)
        try:
            future = self._calls.send(name, parameters)
        except _NOT_SENT as error:
            raise PlacementError(NO_NODE, f"ROS has been shut down here: {error}") from error
        latest = time.monotonic() + ANSWER_WITHIN
        try:
            if (yield from wait_until(lambda: future.done() or None, latest)) is None:
                raise PlacementError(NO_ANSWER, self._unheard(f"{name} was not answered"))
        except BaseException as error:
            if name == "start_with":
                yield from self._leave_beginning(future, isinstance(error, GeneratorExit))
            raise
        return Answer.of(future.result())

    def _silent(self) -> bool:
        """Whether a node that was searching has said nothing for so long that it is dead."""
        status = self.hearing.status
        searching = status is not None and status.state == SEARCHING
        return searching and self.hearing.silent_for >= SILENT_FOR

    def _hear(self, what: Callable[[], T | None], lacking: str) -> Steps[T]:
        """What is published beside an answer, once it has come."""
        heard = yield from wait_until(what, time.monotonic() + ANSWER_WITHIN)
        if heard is None:
            raise PlacementError(NO_ANSWER, self._unheard(lacking))
        return heard

    def _no_node(self, name: str, run: int | None = None) -> PlacementError:
        words = (
            f"nobody offers {self._calls.full_name(name)}; is the node running, with this name and "
            "namespace, and the same ROS_DOMAIN_ID?"
        )
        return PlacementError(NO_NODE, words, run)

    def _unheard(self, words: str, within: float = ANSWER_WITHIN) -> str:
        """The words, and what may be the reason."""
        if self._node.executor is None:
            return f"{words}: nobody spins {self._node.get_fully_qualified_name()}"
        return (
            f"{words} within {within:g} s; has the node died, or the machine too much to "
            "do? Where a callback of this client's node waits, a MultiThreadedExecutor must spin it"
        )


def _begun_run(started: Future) -> int | None:
    """The run that a start has begun, if it has."""
    response = started.result()  # None where it was cancelled
    answer = None if response is None else Answer.of(response)
    return answer.run if answer is not None and answer.success else None


def _seven_numbers(pose: Pose | Sequence[float]) -> list[float]:
    """x y z qx qy qz qw."""
    if not isinstance(pose, Pose):
        return [float(number) for number in pose]
    p, q = pose.position, pose.orientation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
