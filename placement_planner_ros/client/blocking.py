"""The client for executives that wait in a thread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

from geometry_msgs.msg import Pose

from placement_planner_ros.client.calls import Value
from placement_planner_ros.client.connection import Connection
from placement_planner_ros.client.session import Enough
from placement_planner_ros.client.solution import Solution
from placement_planner_ros.client.status import Status
from placement_planner_ros.client.waiting import Steps, finish

T = TypeVar("T")


class PlacementClient(Connection):
    """Plans placements with the node `placement_planner`, and waits for the results.

    Safe to use from several threads. In a callback of `node` its methods may only be called where a
    `MultiThreadedExecutor` spins it and the callback is in a group of its own.
    """

    def wait_until_ready(self, seconds: float) -> Status:
        """The node's status, once it could begin a run at once: nothing is compiled or read any
        more, clouds and joint states arrive.

        Raises:
            PlacementError: not within that time: NO_NODE, or NOT_READY with what is lacking.
        """
        return self._finish(self._conversation.until_ready(seconds))

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
        return self._finish(self._conversation.place(parameters or {}, deadline, until))

    def start(self, parameters: Mapping[str, Value] | None = None, patience: float = 0.0) -> int:
        """Begin a run (`~/start_with`) and leave it running; its number.

        Args:
            parameters: for this run only; its `time_limit` is the node's unless it is among them.
            patience: seconds for which refusals that pass are repeated, as by `place`.

        Raises:
            PlacementError: it was refused.
        """
        return self._finish(self._conversation.start(parameters or {}, patience))

    def stop(self, run: int) -> Solution:
        """End that run (`~/stop_with`), if it has not ended yet; the best it has found.

        Raises:
            PlacementError: it has found nothing, or the robot has left its start, or the node's
                last run is another (WRONG_RUN).
        """
        return self._finish(self._conversation.stop(run))

    def confirm_placed(
        self, solution: Solution | None = None, pose: Pose | Sequence[float] | None = None
    ) -> int:
        """The object stands there now: it becomes obstacle and support. The run's number.

        Args:
            solution: which one of the last run was carried out (`~/confirm_placed_with`); without
                it the best of the last run (`~/confirm_placed`).
            pose: where the object was measured, in the planning frame: m, or x y z qx qy qz qw.

        Raises:
            PlacementError: it was refused.
        """
        return self._finish(self._conversation.confirm(solution, pose))

    def remove_placed(self, placed: Solution | int) -> None:
        """The object that this solution, or run, placed has been taken away (`~/remove_placed`).

        Raises:
            PlacementError: nothing of that run stands (WRONG_RUN).
        """
        self._finish(self._conversation.remove(placed))

    def clear_environment(self) -> None:
        """Forget accumulated points and all objects that were placed (`~/clear_environment`).

        Raises:
            PlacementError: it was refused.
        """
        self._finish(self._conversation.clear())

    def _finish(self, steps: Steps[T]) -> T:
        return finish(steps, self._conversation.news)
