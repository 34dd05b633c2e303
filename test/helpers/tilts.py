"""Bundled cases on tables off level: the whole scene turned about the middle of V's floor."""

from dataclasses import replace

import numpy as np

from benchmarks.cases import read_inputs
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.problem import Problem, workspace
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.types import upright


def slope_of(degrees, azimuth):
    """∂z/∂x and ∂z/∂y of a table tilted by so much, rising towards the azimuth (rad)."""
    steep = np.tan(np.radians(degrees))
    return float(steep * np.cos(azimuth)), float(steep * np.sin(azimuth))


def tilted(points, volume, degrees, azimuth):
    """(n, 3) points turned with the table."""
    # what stays where it is; at z = 0, where the bundled table is
    pivot = np.array([*(0.5 * (volume.lower + volume.upper)[:2]), 0.0])
    return (points - pivot) @ upright(slope_of(degrees, azimuth)).T + pivot


def tilted_problem(case, degrees, azimuth, rng, noise=0.0, **regions):
    """`make_problem` with the cloud turned, and so many metres of noise."""
    made = read_inputs(case, rng)
    points = tilted(made.points, made.volume, degrees, azimuth)
    points = points + rng.normal(0.0, noise, points.shape) if noise else points
    bounds = workspace(made.robot, made.arms, made.q_start, made.body, made.volume)
    environment = Environment.from_points(
        points, made.volume, regions=RegionSettings(**regions), bounds=bounds, beyond_volume=False
    )
    problem = Problem(made.robot, made.arms, made.q_start, made.body, made.volume, environment)
    context = ObjectiveContext(environment, made.volume, made.body)
    return problem, make_objective(case.objective, context)


def tilted_solids(scene, degrees, azimuth):
    """The scene's convex solids turned with the table."""
    return tuple(
        replace(part, vertices=tilted(part.vertices, scene.volume, degrees, azimuth))
        for part in scene.parts
    )
