"""From a snapshot to a planner ready to run; environments are made as clouds arrive, so that start
finds them ready."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.grasp.feasible_grasps import lay_out_holdings
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.planner import PlacementPlanner
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.stopping import StoppedError, step, stoppable
from placement_planner_ros.ros.call_priority import CallPriority
from placement_planner_ros.ros.patience import LOOK_S, REST_S, STOP_PATIENCE_S
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.surroundings import Surroundings, have_same_inputs, settings_for
from placement_planner_ros.ros.spinning import survive

Inputs = Callable[[], tuple[object, Callable[[], Snapshot | None]]]
"""What tells one state of the inputs from another, and their snapshot; None where some miss."""


Prepare = Callable[[Snapshot, Callable[[], bool]], PlacementPlanner]
"""Makes the planner of a run; raises `StoppedError` where it was told to stop first."""


def make_planner(snapshot: Snapshot, environment: Environment) -> PlacementPlanner:
    """The planner of a run.

    Raises:
        PlacementPlannerError: an input is unusable.
    """
    parameters, volume = snapshot.parameters, snapshot.parameters.volume
    robot, arms, q, body = snapshot.robot, snapshot.arms, snapshot.q_start, snapshot.body
    settings, seed = settings_for(parameters, environment.error), parameters["seed"]
    context = settings.context(environment, volume, body)
    return PlacementPlanner(
        Problem(robot, arms, q, body, volume, environment),
        make_objective(parameters["objective"], context),
        settings,
        np.random.default_rng(None if seed < 0 else seed),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Made:
    """An environment, with the fields that every search needs.

    Attributes:
        scene: the same for whatever is held.
    """

    surroundings: Surroundings
    scene: Environment
    environment: Environment


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
        on_error: Callable[[BaseException], None] = lambda _: None,
        calls: CallPriority | None = None,
    ) -> None:
        self._calls = calls or CallPriority()
        self._inputs = inputs
        self._on_error = on_error
        self._idle = idle
        self._making = threading.Lock()  # held while an environment is made
        self._made: _Made | None = None
        self._run: Snapshot | None = None  # of the run that waits for its environment
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
            self._ahead.join(STOP_PATIENCE_S)

    def prepare(self, snapshot: Snapshot, should_stop: Callable[[], bool]) -> PlacementPlanner:
        """The planner of a run.

        Raises:
            StoppedError: it was told to stop first.
            PlacementPlannerError: an input is unusable.
        """
        # seen by whoever prepares ahead, who gives up what this run has no use for
        self._run = snapshot
        self._calls.give_way()  # to the answer that there is a run
        try:
            with stoppable(should_stop):
                # who prepares ahead lets go as soon as a run wants something else
                while not self._making.acquire(timeout=REST_S):
                    step("making the environment of the clouds")
                try:
                    made = self._make(snapshot)
                finally:
                    self._making.release()
                return make_planner(snapshot, made.environment)
        finally:
            if self._run is snapshot:  # another one may have begun since
                self._run = None

    def ready(self, snapshot: Snapshot) -> Environment | None:
        """The environment of that run where it is there already, without a look at its points."""
        # without the lock, as it is replaced as a whole
        made = self._made
        if made is None or not have_same_inputs(made.surroundings.snapshot, snapshot):
            return None
        return made.environment

    def look(self) -> bool:
        """Prepare for the inputs of now, in this thread, where they are others than last time.

        Returns:
            Whether none are missing.
        """
        # Whatever is raised: a run that comes meets the same, and tells it; what comes after that
        # run must find its environment ready again.
        return survive(self._look, self._on_error) is not False

    def _look(self) -> bool:
        # told before the snapshot is taken: what changes in between is looked at once more
        state, take_snapshot = self._inputs()
        if state == self._seen:
            return True
        snapshot = take_snapshot()
        # what was given up is tried again at the next look
        if snapshot is not None and self.ahead(snapshot):
            self._seen = state
        return snapshot is not None

    def ahead(self, snapshot: Snapshot) -> bool:
        """Prepare for a run that may come, in this thread; its errors are left to that run.

        Returns:
            Whether that came to an end, and not to nothing as a run wants something else.
        """

        def unwanted() -> bool:
            self._calls.give_way()
            run = self._run
            return self._closed.is_set() or not (run is None or have_same_inputs(run, snapshot))

        with contextlib.suppress(StoppedError), stoppable(unwanted), self._making:
            with contextlib.suppress(PlacementPlannerError):
                self._make(snapshot)
            return True
        return False

    def _make(self, snapshot: Snapshot) -> _Made:
        """The environment, and what depends on robot and object alone, where they are others than
        last time; the lock is held."""
        made = self._made
        before = None if made is None else made.surroundings
        surroundings = Surroundings.of(snapshot, before)
        if made is None or surroundings is not before:
            # another object, or another posture, changes the environment but not the scene
            same_scene = made is not None and made.surroundings.same_scene(surroundings)
            scene = made.scene if made is not None and same_scene else surroundings.scene()
            # what the search would do first, and what start asks for
            _ = scene.clearance
            _ = scene.has_unseen_ceiling
            environment = surroundings.environment(scene)
            step("making boxes of the obstacle set")
            box_arrays(environment.obstacles)
            self._made = made = _Made(surroundings, scene, environment)
        # the same for every search with this robot and object
        robot, body = wanted = snapshot.robot, snapshot.body
        if self._laid_out != wanted:
            settings = snapshot.parameters.planner_settings.grasp
            lay_out_holdings(robot, snapshot.arms, snapshot.q_start, body, settings)
            self._laid_out = wanted
        return made

    def _look_ahead(self) -> None:
        rest = LOOK_S
        while not self._closed.wait(rest):
            began = time.thread_time()
            if self._idle():
                self.look()
            # three times as long as it worked, so that it takes a fourth of a core and no more
            rest = max(LOOK_S, 3.0 * (time.thread_time() - began))
