"""The paper's 24 cases: three scenes, four objects, clearance maximised and minimised.

Other objects make further groups of cases, in the same scenes.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from benchmarks.household import HOUSEHOLD, OBJECT_NAMES, SINGLE_MESHES, object_by_name
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import Objective, ObjectiveContext
from placement_planner_ros.core.problem import Problem, workspace
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.scenes.clouds import camera_clouds, complete_cloud
from placement_planner_ros.scenes.scenes import SCENE_NAMES, Scene, scene_by_name
from placement_planner_ros.scenes.yumi import load_yumi, start_configuration, yumi_arm

OBJECTIVE_WORDS = {
    "maximize_clearance": "maximised clearance",
    "minimize_clearance": "minimised clearance",
}
OBJECTIVES = tuple(OBJECTIVE_WORDS)
Cloud = Literal["complete", "cameras"]
GROUPS = {"paper": OBJECT_NAMES, "single_meshes": SINGLE_MESHES, "household": HOUSEHOLD}
"""The objects of each group of cases."""
PARTS = {"part_of_table": TargetVolume([0.2475, -0.3175, -0.05], [0.5865, 0.3655, 0.02])}
"""V that is a part of the table's, what is around it counting, too, as in the demonstration."""


@dataclass(frozen=True, slots=True)
class Case:
    """A test case, with the kind of cloud it is seen through."""

    scene: str
    object: str
    objective: str
    cloud: Cloud = "complete"

    def __str__(self) -> str:
        return f"{self.scene}/{self.object}/{self.objective}/{self.cloud}"


def all_cases(cloud: Cloud = "complete", objects: tuple[str, ...] = OBJECT_NAMES) -> list[Case]:
    """The 24 cases, scene by scene; or those of other objects."""
    return [
        Case(scene, name, objective, cloud)
        for scene, name, objective in itertools.product(SCENE_NAMES, objects, OBJECTIVES)
    ]


def case_scene(name: str) -> Scene:
    """One of the bundled scenes, or the table with V a part of it."""
    part = PARTS.get(name)
    return scene_by_name(name) if part is None else replace(scene_by_name("table"), volume=part)


def in_words(name: str) -> str:
    """A name of the code as text: `large_crayons_box` -> `large crayons box`."""
    return name.replace("_", " ")


def case_label(case: Case) -> str:
    """A case in a line of a table or an axis."""
    sign = "max" if case.objective == "maximize_clearance" else "min"
    return f"{in_words(case.scene)}, {in_words(case.object)}, {sign}"


def scene_points(case: Case, rng: np.random.Generator) -> Array:
    """(n, 3) points of the case's cloud in the world frame; NaN where a camera saw nothing."""
    if case.cloud == "complete":
        return _complete_points(case.scene).copy()
    scene = case_scene(case.scene)
    return np.vstack([cloud.world_points().reshape(-1, 3) for cloud in camera_clouds(scene, rng)])


@functools.lru_cache(maxsize=4)
def _complete_points(scene: str) -> Array:
    return complete_cloud(case_scene(scene))


@dataclass(frozen=True, slots=True, eq=False)
class CaseInputs:
    """What a node would have received before it is told to start.

    Attributes:
        points: (n, 3) the cloud in the world frame.
        beyond_volume: whether things outside V count for clearance, too, unlike in the paper.
    """

    robot: Robot
    arms: tuple[Arm, ...]
    q_start: Array
    body: Body
    volume: TargetVolume
    points: Array
    beyond_volume: bool = False


def inputs_of(thing: str, volume: TargetVolume, points: Array) -> CaseInputs:
    """The YuMi with one of the bundled objects, V and a cloud (n, 3) in the world frame."""
    robot, held = load_yumi(), object_by_name(thing)
    return CaseInputs(
        robot,
        tuple(yumi_arm(robot, name, grasps) for name, grasps in held.grasps.items()),
        robot.configuration(start_configuration(held)),
        Body.from_mesh(held.vertices, held.triangles, held.center_of_mass),
        volume,
        points,
    )


def read_inputs(case: Case, rng: np.random.Generator) -> CaseInputs:
    """Robot, object and cloud of a case.

    Args:
        rng: noise of the camera clouds.
    """
    made = inputs_of(case.object, case_scene(case.scene).volume, scene_points(case, rng))
    return replace(made, beyond_volume=case.scene in PARTS)


def build_problem(
    inputs: CaseInputs,
    objective: str,
    unknown: Callable[[Environment], Environment] = lambda made: made,
    **environment: Any,
) -> tuple[Problem, Objective]:
    """The environment from the cloud, and the objective of that name in it.

    Args:
        unknown: adds what no sensor saw, as `Environment.with_unknown`.
        environment: further arguments of `Environment.from_points`.
    """
    robot, arms, q_start = inputs.robot, inputs.arms, inputs.q_start
    body, volume = inputs.body, inputs.volume
    given: dict[str, Any] = {
        "bounds": workspace(robot, arms, q_start, body, volume),
        "beyond_volume": inputs.beyond_volume,
    }
    made = unknown(Environment.from_points(inputs.points, volume, **(given | environment)))
    problem = Problem(robot, arms, q_start, body, volume, made)
    return problem, make_objective(objective, ObjectiveContext(made, volume, body))


def make_problem(case: Case, rng: np.random.Generator) -> tuple[Problem, Objective]:
    """Build a case from its cloud, as the node would.

    Args:
        rng: noise of the camera clouds.
    """
    return build_problem(read_inputs(case, rng), case.objective)


def boxes_ready(problem: Problem) -> None:
    """The boxes of the environment as the collision checks want them, as the node prepares them."""
    box_arrays(problem.environment.obstacles)
