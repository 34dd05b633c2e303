"""Planning to a set of goals: recorded queries, by the goal-set planner and by stock RRTConnect."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from placement_planner_ros.core.plan_motion.transit import MotionPlanner
from placement_planner_ros.core.types import Array
from placement_planner_ros.experiments.baselines.exact_collision import ExactCollision
from placement_planner_ros.experiments.baselines.plain import STEP, rrt_connect
from placement_planner_ros.experiments.speed.queries import Entry
from placement_planner_ros.experiments.speed.recorder import GoalSetQuery, Recording


def measure_goal_sets(
    recording: Recording, plain: int, limit: float, rng: np.random.Generator
) -> Iterator[Entry]:
    """Wall time until a path to one of the goals is there; unsolved queries take their limit.

    Args:
        plain: how many of the queries, spread over them, stock RRTConnect with coal is given too.
        limit: seconds for a query.
    """
    queries = recording.goal_sets
    both = set(np.linspace(0, len(queries) - 1, min(plain, len(queries))).astype(int).tolist())
    for number, query in enumerate(queries):
        entry: dict[str, Any] = {
            "row": "goal_sets",
            "case": str(recording.case),
            "goals": len(query.goals),
            "limit": limit,
        }
        started, cpu = time.perf_counter(), time.process_time()
        path = _goal_set_planner(recording, query, limit, rng)
        entry |= _outcome("", path, time.perf_counter() - started, limit)
        entry["cpu_seconds"] = time.process_time() - cpu
        if number in both:
            exact = ExactCollision(
                recording.problem.robot,
                query.holding.arm,
                query.holding.grasp,
                recording.problem.body,
                recording.problem.environment.obstacles,
                recording.problem.q_start,
                recording.settings.collision,
            )
            reserve = recording.settings.collision.planning_reserve

            def edge_free(a: Array, b: Array, exact: Any = exact, reserve: Any = reserve) -> bool:
                return bool(exact.edge_free(a, b, STEP, reserve))

            goals = [goal.q_raised for goal in query.goals]
            started = time.perf_counter()
            path = rrt_connect(query.holding, goals, edge_free, limit)
            entry |= _outcome("plain_", path, time.perf_counter() - started, limit)
        yield entry


def _goal_set_planner(
    recording: Recording, query: GoalSetQuery, limit: float, rng: np.random.Generator
) -> Array | None:
    """As `PlacementPlanner` plans, from an empty forward tree."""
    deadline = time.perf_counter() + limit

    def late() -> bool:
        return time.perf_counter() > deadline

    planner = MotionPlanner([query.holding], recording.settings.transit, rng)
    for goal in query.goals:
        planner.add(goal)
    while not late():
        found = planner.plan(recording.settings.motion_iterations, late)
        if found is not None:
            return found[1]
    return None


def _outcome(prefix: str, path: Array | None, seconds: float, limit: float) -> dict[str, Any]:
    return {
        f"{prefix}solved": path is not None,
        f"{prefix}seconds": seconds if path is not None else max(limit, seconds),
    }
