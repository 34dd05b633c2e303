"""What the tests of the client do beside it: a robot's sensors, and searches as they are wanted."""

import threading

from helpers.fakes import placement

from placement_planner_ros.client import PlacementError


class Sensors:
    """Joint states of a robot at rest, until it is moved."""

    def __init__(self, b):
        self.changes = {}
        self._bench = b
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._publish)
        self._thread.start()

    def _publish(self):
        while not self._ended.wait(0.03):
            self._bench.joint_state(**self.changes)

    def move(self, position):
        """Have the robot jump."""
        self.changes = {"yumi_joint_5_l": position}
        joints = self._bench.node._inputs.joints
        self._bench.wait(lambda: joints.positions()["yumi_joint_5_l"] == position)

    def close(self):
        self._ended.set()
        self._thread.join()


class Doing(threading.Thread):
    """Does something in a thread of its own, and keeps what it came to."""

    def __init__(self, act):
        super().__init__(daemon=True)
        self._act = act
        self._came_to = None
        self.start()

    def run(self):
        try:
            self._came_to = self._act(), None
        except PlacementError as error:
            self._came_to = None, error

    @property
    def result(self):
        result, error = self._outcome()
        assert error is None, error
        return result

    @property
    def error(self):
        result, error = self._outcome()
        assert result is None, result
        return error

    def _outcome(self):
        self.join(240.0)
        assert self._came_to is not None, "it does not come to an end"
        return self._came_to


def searching(b, number=1):
    """The planner of the run of that number, once it searches."""
    b.wait(lambda: len(b.planners) >= number)
    b.wait(b.planners[number - 1].searching.is_set)
    return b.planners[number - 1]


def found(b, *objectives, number=1, **options):
    """Have the run find these, one after the other."""
    planner = searching(b, number)
    run = b.node._commands.run
    for objective in objectives:
        count = run.solutions + 1
        planner.offers.append(placement(objective, **options))
        b.wait(lambda count=count: run.solutions >= count)


def ended(b):
    """Whether no worker is at work."""
    run = b.node._commands.run
    return run is not None and not run.active


def service_of(b, name="start_with"):
    """A service of the node, whose callback may be another."""
    return next(s for s in b.node.services if s.service_name.endswith(f"/{name}"))
