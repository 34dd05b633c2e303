"""Environments made as clouds arrive, so that start finds them ready."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.grasp.feasible_grasps import lay_out_holdings
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.stopping import StoppedError, step, stoppable
from placement_planner_ros.ros.call_priority import CallPriority
from placement_planner_ros.ros.run.planning import Prepared, make_planner
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.surroundings import Surroundings

LOOK = 0.2
"""Seconds between looks at whether the inputs have changed, at least."""
SHARE = 0.25
"""Of one core that preparing ahead takes at most, on average."""
_CLOSING = 0.5
"""Seconds that closing waits at most."""
_PATIENCE = 0.005
"""Seconds between looks at whether a run that waits for its environment has been stopped."""

Inputs = Callable[[], tuple[object, Callable[[], Snapshot | None]]]
"""What tells one state of the inputs from another, and their snapshot; None where some miss."""


class _Build:
    """An environment in the making, with the fields that every search needs.

    Attributes:
        ended: set once there is an environment, an error, or neither as nobody wants it any more.
        scene: of the surroundings, the same for whatever is held; None until it is made.

    Args:
        scene: where one of the same scene is there already.
    """

    def __init__(self, surroundings: Surroundings, scene: Environment | None = None) -> None:
        self.surroundings = surroundings
        self.scene = scene
        self.ended = threading.Event()
        self.unwanted = False
        self.error: BaseException | None = None
        self._environment: Environment | None = None

    @property
    def made(self) -> bool:
        """Whether the environment is there."""
        return self._environment is not None

    @property
    def environment(self) -> Environment:
        """What was made.

        Raises:
            PlacementPlannerError: the clouds are unusable.
        """
        if self.error is not None:
            raise self.error
        assert self._environment is not None
        return self._environment

    def work(self, give_way: Callable[[], None] | None = None) -> None:
        """Make it; between two steps, gives up where it is unwanted and first calls `give_way`."""

        def unwanted() -> bool:
            if give_way is not None:
                give_way()
            return self.unwanted

        try:
            with stoppable(unwanted):
                if self.scene is None:
                    self.scene = self.surroundings.scene()
                _ = self.scene.clearance
                _ = self.scene.has_unseen_ceiling  # so that start finds it ready
                environment = self.surroundings.environment(self.scene)
                step("making boxes of the obstacle set")
                box_arrays(environment.obstacles)
                self._environment = environment
        except BaseException as error:  # raised again in the thread that asks for the environment
            self.error = error
        finally:
            self.ended.set()


class _Order:
    """An environment that a run waits for.

    Attributes:
        ended: set once there is an environment, an error, or neither as nobody wants it any more.
    """

    def __init__(self) -> None:
        self.ended = threading.Event()
        self.unwanted = False
        self.error: BaseException | None = None
        self.build: _Build | None = None

    @property
    def environment(self) -> Environment:
        """What was made.

        Raises:
            PlacementPlannerError: the clouds are unusable.
        """
        if self.error is not None:
            raise self.error
        assert self.build is not None
        return self.build.environment

    @property
    def flying(self) -> int:
        """How many points were left out as flying pixels."""
        assert self.build is not None
        return self.build.surroundings.flying


class Preparation:
    """Keeps the environment of the newest inputs ready. Safe to use from several threads.

    What a run gets depends on its snapshot alone: an environment made ahead is taken only where
    the run's own points, bounds and settings are the same.

    Args:
        inputs: what there is now.
        idle: whether there is leisure to prepare anything.
        on_error: told of what is raised while preparing ahead.
        calls: what is prepared ahead, and a run's beginning, give way to their answers.
    """

    def __init__(
        self,
        inputs: Inputs,
        idle: Callable[[], bool],
        on_error: Callable[[Exception], None] = lambda _: None,
        calls: CallPriority | None = None,
    ) -> None:
        self._calls = calls or CallPriority()
        self._inputs = inputs
        self._on_error = on_error
        self._idle = idle
        self._lock = threading.Lock()
        self._newest: _Build | None = None
        self._order: _Order | None = None
        self._runs = 0
        self._seen: object = None
        self._laid_out: tuple[Robot, Body] | None = None
        self._closed = threading.Event()
        self._ahead = threading.Thread(target=self._look_ahead, name="preparation", daemon=True)

    def start(self) -> None:
        """From now on prepare ahead."""
        self._ahead.start()

    def close(self) -> None:
        """Begin nothing more, and wait a little for what is being made."""
        self._closed.set()
        if self._ahead.is_alive():
            self._ahead.join(_CLOSING)

    @property
    def busy(self) -> bool:
        """Whether something is being made."""
        waited_for = (self._newest, self._order)
        making = any(thing is not None and not thing.ended.is_set() for thing in waited_for)
        return self._ahead.is_alive() or making

    def prepare(self, snapshot: Snapshot, should_stop: Callable[[], bool]) -> Prepared:
        """The planner of a run.

        Raises:
            StoppedError: it was told to stop first.
            PlacementPlannerError: an input is unusable.
        """
        with self._lock:
            self._runs += 1  # from now on nothing is prepared ahead
        self._calls.give_way()  # to the answer that there is a run
        try:
            order = self._order = _Order()
            threading.Thread(
                target=self._fulfil, args=(snapshot, order), name="environment", daemon=True
            ).start()
            with stoppable(should_stop):
                try:
                    self._wait(order, snapshot)
                except StoppedError:
                    order.unwanted = True
                    raise
                return replace(make_planner(snapshot, order.environment), flying=order.flying)
        finally:
            with self._lock:
                self._runs -= 1

    def _wait(self, order: _Order, snapshot: Snapshot) -> None:
        """Until the environment is made; meanwhile make what depends on robot and object alone."""
        if not order.ended.wait(_PATIENCE):
            self._lay_out(snapshot)
        while not order.ended.wait(_PATIENCE):
            step("making the environment of the clouds")

    def ready(self, snapshot: Snapshot) -> Environment | None:
        """The environment of that run where it is there already, without a look at its points."""
        build = self._newest
        if build is None or not build.made or not build.surroundings.made_of(snapshot):
            return None
        return build.environment

    def look(self) -> bool:
        """Prepare for the inputs of now, in this thread, where they are others than last time.

        Returns:
            Whether none are missing.
        """
        try:
            state, take_snapshot = self._inputs()
            if state == self._seen:
                return True
            snapshot = take_snapshot()
            if snapshot is None:
                return False
            self._seen = state
            self.ahead(snapshot)
        except Exception as error:
            # Whatever is raised: a run that comes meets the same, and tells it; what comes after
            # that run must find its environment ready again.
            self._on_error(error)
        return True

    def ahead(self, snapshot: Snapshot) -> None:
        """Prepare for a run that may come, in this thread; its errors are left to that run."""
        surroundings = Surroundings.of(snapshot, self._before())
        with self._lock:
            if self._runs:
                return
            build, new = self._build(surroundings)
        if new:
            build.work(self._calls.give_way)
        with contextlib.suppress(StoppedError), stoppable(self._unwanted):
            self._lay_out(snapshot)

    def _lay_out(self, snapshot: Snapshot) -> None:
        """Make what depends on robot and object alone, where they are others than last time."""
        wanted = snapshot.robot, snapshot.body
        if self._laid_out != wanted:
            settings = snapshot.parameters.planner_settings.grasp
            lay_out_holdings(
                snapshot.robot, snapshot.arms, snapshot.q_start, snapshot.body, settings
            )
            self._laid_out = wanted

    def _fulfil(self, snapshot: Snapshot, order: _Order) -> None:
        """Make a run's environment, or wait for it where it is being made."""
        try:
            surroundings = Surroundings.of(snapshot, self._before())
            with self._lock:
                if order.unwanted:
                    return
                build, new = self._build(surroundings)
            if new:
                build.work()  # to its end, unless other inputs come: the next run may need it
            else:
                build.ended.wait()
            order.build = build
        except BaseException as error:  # raised again in the run's thread
            order.error = error
        finally:
            order.ended.set()

    def _unwanted(self) -> bool:
        self._calls.give_way()
        return self._runs > 0 or self._closed.is_set()

    def _before(self) -> Surroundings | None:
        build = self._newest
        return None if build is None else build.surroundings

    def _build(self, surroundings: Surroundings) -> tuple[_Build, bool]:
        """The build of these surroundings, and whether it is yet to be worked on; lock held."""
        newest, scene = self._newest, None
        if newest is not None:
            if newest.error is None and newest.surroundings.same(surroundings):
                return newest, False
            newest.unwanted = True
            if newest.surroundings.same_scene(surroundings):
                scene = newest.scene
        self._newest = _Build(surroundings, scene)
        return self._newest, True

    def _look_ahead(self) -> None:
        rest = LOOK
        while not self._closed.wait(rest):
            began = time.thread_time()
            if self._idle():
                self.look()
            rest = max(LOOK, (time.thread_time() - began) * (1.0 / SHARE - 1.0))
