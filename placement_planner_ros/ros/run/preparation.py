"""From a snapshot to a planner ready to run; environments are made as clouds arrive, so that start
finds them ready."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.grasp.feasible_grasps import lay_out_holdings
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.planner import PlacementPlanner
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.cloud import cropped
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.stopping import StoppedError, step, stoppable
from placement_planner_ros.core.warmup.known_robot import known_robot
from placement_planner_ros.ros.call_priority import CallPriority
from placement_planner_ros.ros.inputs import point_cloud
from placement_planner_ros.ros.inputs.self_filter import Outline, near_points
from placement_planner_ros.ros.patience import CLOSING_S, LOOK_S
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.surroundings import Surroundings

Made = TypeVar("Made")

CORE_SHARE = 0.25
"""Of one core that preparing ahead takes at most, on average."""

Inputs = Callable[[], tuple[object, Callable[[], Snapshot | None]]]
"""What tells one state of the inputs from another, and their snapshot; None where some miss."""


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """A planner and what it plans in.

    Attributes:
        flying: how many points of the clouds were left out as flying pixels.
    """

    planner: PlacementPlanner
    environment: Environment
    flying: int = 0


Prepare = Callable[[Snapshot, Callable[[], bool]], Prepared]
"""Makes the planner of a run; raises `StoppedError` where it was told to stop first."""


def make_planner(snapshot: Snapshot, environment: Environment) -> PlacementPlanner:
    """The planner of a run.

    Raises:
        PlacementPlannerError: an input is unusable.
    """
    parameters, volume = snapshot.parameters, snapshot.parameters.volume
    robot, arms, q, body = snapshot.robot, snapshot.arms, snapshot.q_start, snapshot.body
    settings, seed = parameters.planner_settings, parameters["seed"]
    context = settings.context(environment, volume, body)
    return PlacementPlanner(
        Problem(robot, arms, q, body, volume, environment),
        make_objective(parameters["objective"], context),
        settings,
        np.random.default_rng(None if seed < 0 else seed),
    )


def load_input_kernels() -> None:
    """Read, filter and crop a cloud of one point."""
    robot, _ = known_robot()
    outline = Outline.of_robot(robot, np.zeros(robot.model.nq), 0.0)
    near_points(np.zeros((1, 3)), outline, {}, 0.0, GridSettings())
    point_cloud.warm_up()
    cropped(np.zeros(3), np.ones(3), np.zeros((1, 3)), 1.0)


class _Build:
    """An environment in the making, with the fields that every search needs.

    Attributes:
        scene: of the surroundings, the same for whatever is held; None until it is made.

    Args:
        scene: where one of the same scene is there already.
    """

    def __init__(self, surroundings: Surroundings, scene: Environment | None = None) -> None:
        self.surroundings = surroundings
        self.scene = scene
        self.made: Future[Environment] = Future()
        self.unwanted = False

    @property
    def environment(self) -> Environment:
        """What was made, once it is.

        Raises:
            PlacementPlannerError: the clouds are unusable.
            StoppedError: other inputs came meanwhile.
        """
        return self.made.result()

    @property
    def has_failed(self) -> bool:
        """Whether there will be none."""
        return self.made.done() and self.made.exception() is not None

    def work(self, give_way: Callable[[], None] = lambda: None) -> None:
        """Make it; between two steps, first calls `give_way`, and gives up where it is unwanted."""

        def unwanted() -> bool:
            give_way()
            return self.unwanted

        def make() -> Environment:
            with stoppable(unwanted):
                if self.scene is None:
                    self.scene = self.surroundings.scene()
                _ = self.scene.clearance
                _ = self.scene.has_unseen_ceiling  # so that start finds it ready
                environment = self.surroundings.environment(self.scene)
                step("making boxes of the obstacle set")
                box_arrays(environment.obstacles)
                return environment

        _fulfil(self.made, make)


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
            self._ahead.join(CLOSING_S)

    def prepare(self, snapshot: Snapshot, should_stop: Callable[[], bool]) -> Prepared:
        """The planner of a run.

        Raises:
            StoppedError: it was told to stop first.
            PlacementPlannerError: an input is unusable.
        """
        with self._lock:
            self._runs += 1  # from now on nothing is prepared ahead
        self._calls.give_way()  # to the answer that there is a run
        order: Future[_Build] = Future()
        # To its end, unless other inputs come: should this run be stopped, the next may need it.
        threading.Thread(
            target=_fulfil, args=(order, lambda: self._built(snapshot)), daemon=True
        ).start()
        try:
            with stoppable(should_stop):
                self._lay_out(snapshot)  # meanwhile
                while not wait([order], LOOK_S).done:
                    step("making the environment of the clouds")
                build = order.result()
                planner = make_planner(snapshot, build.environment)
                return Prepared(planner, build.environment, build.surroundings.flying)
        finally:
            with self._lock:
                self._runs -= 1

    def ready(self, snapshot: Snapshot) -> Environment | None:
        """The environment of that run where it is there already, without a look at its points."""
        build = self._newest
        made = build is not None and build.made.done() and not build.has_failed
        if build is None or not made or not build.surroundings.made_of(snapshot):
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
        surroundings = self._surroundings(snapshot)
        with self._lock:
            if self._runs:
                return
            build, new = self._build(surroundings)
        if new:
            build.work(self._calls.give_way)
        with contextlib.suppress(StoppedError), stoppable(self._is_unwanted):
            self._lay_out(snapshot)

    def _lay_out(self, snapshot: Snapshot) -> None:
        """Make what depends on robot and object alone, where they are others than last time."""
        robot, body = wanted = snapshot.robot, snapshot.body
        if self._laid_out != wanted:
            settings = snapshot.parameters.planner_settings.grasp
            lay_out_holdings(robot, snapshot.arms, snapshot.q_start, body, settings)
            self._laid_out = wanted

    def _built(self, snapshot: Snapshot) -> _Build:
        """A run's environment, once it is made."""
        surroundings = self._surroundings(snapshot)
        with self._lock:
            build, new = self._build(surroundings)
        if new:
            build.work()
        wait([build.made])
        return build

    def _is_unwanted(self) -> bool:
        self._calls.give_way()
        return self._runs > 0 or self._closed.is_set()

    def _surroundings(self, snapshot: Snapshot) -> Surroundings:
        build = self._newest
        return Surroundings.of(snapshot, None if build is None else build.surroundings)

    def _build(self, surroundings: Surroundings) -> tuple[_Build, bool]:
        """The build of these surroundings, and whether it is yet to be worked on; lock held."""
        newest, scene = self._newest, None
        if newest is not None:
            if not newest.has_failed and newest.surroundings.same(surroundings):
                return newest, False
            newest.unwanted = True
            if newest.surroundings.same_scene(surroundings):
                scene = newest.scene
        self._newest = _Build(surroundings, scene)
        return self._newest, True

    def _look_ahead(self) -> None:
        rest = LOOK_S
        while not self._closed.wait(rest):
            began = time.thread_time()
            if self._idle():
                self.look()
            rest = max(LOOK_S, (time.thread_time() - began) * (1.0 / CORE_SHARE - 1.0))


def _fulfil(promise: Future[Made], make: Callable[[], Made]) -> None:
    """Keep a promise; what is raised is raised again in the thread that asks for the result."""
    try:
        promise.set_result(make())
    except BaseException as error:
        promise.set_exception(error)
