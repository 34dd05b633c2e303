"""The requests of docs/wishes.md, and what they are made of."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from checker import Asked
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.planner import PlacementPlanner
from placement_planner_ros.ros.parameters.table import arm_specs, arms_spec, fixed_specs
from placement_planner_ros.ros.parameters.values import ParameterSet

PAGE = Path(__file__).parents[2] / "docs" / "wishes.md"
_REQUEST = re.compile(
    r'^\d+\. "([^"]+)" \(`(\w+)`, `(\w+)`(?:; drop `([\w.]+)`)?\)\n\n   ```yaml\n([^`]*)   ```$',
    re.MULTILINE,
)
_SPECS = {s.name: s for s in [*fixed_specs(), arms_spec(["left"]), *arm_specs("left", yumi=True)]}


@dataclass(frozen=True)
class Request:
    """One request.

    Attributes:
        drop: the rule without which an impossible one can be had; '' where it can.
        values: parameters by name.
    """

    words: str
    scene: str
    thing: str
    drop: str
    values: dict[str, Any]

    @property
    def case(self) -> Case:
        """What it is asked of."""
        return Case(self.scene, self.thing, "maximize_clearance")

    @property
    def parameters(self) -> ParameterSet:
        """As the node would take them."""
        return ParameterSet(_SPECS, self.values)

    @property
    def freed(self) -> Request:
        """The same without the rule to be dropped."""
        gone = {self.drop, "require_at_least"} if self.drop == "require_terms" else {self.drop}
        return replace(self, values={n: v for n, v in self.values.items() if n not in gone})

    @property
    def asked(self) -> Asked:
        """For the checker."""
        given = self.parameters
        terms, weights = given["objective_terms"], given["objective_weights"]
        weights = {
            "weighted": dict(zip(terms, weights or [1.0] * len(terms), strict=True)),
            "toward_front": {"toward_front": 1.0},
        }.get(given["objective"], {})
        return Asked(
            up=np.array(given["object.up"]) if given["object.up"] else None,
            up_tolerance=given["object.up_tolerance"],
            front=np.array(given["object.front"]) if given["object.front"] else None,
            front_direction=given["object.front_direction"],
            front_tolerance=given["object.front_tolerance"],
            near_pose=np.array(given["near_pose"]) if given["near_pose"] else None,
            weights=weights,
            at_least=dict(zip(given["require_terms"], given["require_at_least"], strict=True)),
        )

    def planner(self, seed: int) -> PlacementPlanner:
        """One that searches for it."""
        problem, _ = problem_of(self.case)
        settings = self.parameters.planner_settings
        context = settings.context(problem.environment, problem.volume, problem.body)
        objective = make_objective(self.parameters["objective"], context)
        return PlacementPlanner(problem, objective, settings, np.random.default_rng(seed))


def requests() -> list[Request]:
    """All of the page, in order."""
    return [
        Request(words, scene, thing, drop, yaml.safe_load(text))
        for words, scene, thing, drop, text in _REQUEST.findall(PAGE.read_text(encoding="utf-8"))
    ]
