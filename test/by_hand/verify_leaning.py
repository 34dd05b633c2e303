"""Release what the planner leaned in a physics engine, off by up to 2 mm and 1 degree.

python test/by_hand verify_leaning --draws 100
"""

from __future__ import annotations

import argparse

import numpy as np
from helpers.leaning import disturbed
from helpers.problems import problem_of
from helpers.settle import settle

from benchmarks.cases import Case
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.scenes import scene_by_name

CASES = (
    ("cabinet_low_clutter", "small_crayons_box"),
    ("cabinet_high_clutter", "large_crayons_box"),
    ("table", "small_crayons_box"),
)
MOVED, TILTED = 0.008, np.deg2rad(3.0)
"""m and rad that what was released may come away."""


def near(parts, point, within):
    """Vertices of those parts that come as near as that to a point."""
    boxes = [(part.vertices.min(axis=0), part.vertices.max(axis=0)) for part in parts]
    away = [np.linalg.norm(np.clip(point, low, high) - point) for low, high in boxes]
    return [part.vertices for part, far in zip(parts, away, strict=True) if far < within]


def main() -> None:
    """Print one line a placement."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--seed", type=int, default=3)
    asked = parser.parse_args()
    rng = np.random.default_rng(asked.seed)
    for scene, name in CASES:
        problem, objective = problem_of(Case(scene, name, "maximize_clearance"))
        settings = PlannerSettings(contacts=("lean",))
        planner = PlacementPlanner(problem, objective, settings, np.random.default_rng(asked.seed))
        found = next(planner.run(lambda p=planner: p.statistics.samples > 20_000), None)
        if found is None:
            print(scene, name, "nothing found", flush=True)
            continue
        held, T = object_by_name(name), found.goal.T_world_object.homogeneous
        center = T[:3, :3] @ problem.body.center_of_mass + T[:3, 3]
        solids = near(scene_by_name(scene).parts, center, 0.3)
        pieces = [part.vertices for part in held.parts]
        for factor in (1.0, 1.5):
            results = [
                settle(
                    solids,
                    pieces,
                    problem.body.center_of_mass,
                    disturbed(T, problem.body.center_of_mass, rng),
                    friction=factor * settings.friction,
                    noslip=10,
                )
                for _ in range(asked.draws)
            ]
            stay = sum(each.moved < MOVED and each.tilted < TILTED for each in results)
            print(f"{scene} {name}, friction {factor:g}x: {stay} of {asked.draws} stay", flush=True)


if __name__ == "__main__":
    main()
