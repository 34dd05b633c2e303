"""From a cloud to everything that planning needs of the environment."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.speed.rows import Entry
from placement_planner_ros.core.collision.boxes import box_arrays
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.scene.clearance import ClearanceField
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.types import Array
from placement_planner_ros.scenes.clouds import camera_clouds, complete_cloud, scene_cameras
from placement_planner_ros.scenes.scenes import Scene, scene_by_name

POINTS = 300_000
SIZE = np.array([1.6, 1.6, 1.4])
"""m, of the workspace, about the middle of V."""
CELL = 0.01
"""m."""
KINDS = ("clean", "noisy")
_SPACINGS = (0.005, 0.004, 0.003, 0.002, 0.001)
_PIXELS = (1, 2, 3, 4)


def measure_clouds(scene_name: str, repeats: int, rng: np.random.Generator) -> Iterator[Entry]:
    """Obstacle set, regions, support, clearance and collision fields of a scene's clouds.

    Args:
        repeats: timed runs, after one that is not.
        rng: noise of the cameras, and which points are kept.
    """
    scene = scene_by_name(scene_name)
    middle = (scene.volume.lower + scene.volume.upper) / 2
    bounds = middle - SIZE / 2, middle + SIZE / 2
    for kind in KINDS:
        points = make_cloud(scene, kind, bounds, rng)
        for repeat in range(-1, repeats):
            started, cpu = time.perf_counter(), time.process_time()
            environment = Environment.from_points(
                points, scene.volume, GridSettings(cell_size=CELL), RegionSettings(), bounds
            )
            parts = [time.perf_counter()]
            ClearanceField(environment.measured, scene.volume).distance(middle[None])
            parts.append(time.perf_counter())
            box_arrays(environment.obstacles)
            parts.append(time.perf_counter())
            cpu = time.process_time() - cpu
            if repeat >= 0:
                yield {
                    "row": "clouds",
                    "scene": scene_name,
                    "kind": kind,
                    "points": len(points),
                    "boxes": len(environment.obstacles.lower),
                    "regions": len(environment.regions),
                    "seconds": parts[-1] - started,
                    "cpu_seconds": cpu,
                    "environment_seconds": parts[0] - started,
                    "clearance_seconds": parts[1] - parts[0],
                    "collision_field_seconds": parts[2] - parts[1],
                }


def make_cloud(
    scene: Scene, kind: str, bounds: tuple[Array, Array], rng: np.random.Generator
) -> Array:
    """(POINTS, 3) points within the bounds: of the whole surface, or as depth cameras see it.

    The spacing of the points, or the cameras' resolution, is the coarsest that gives enough.
    """
    for spacing, scale in zip(_SPACINGS, (*_PIXELS, _PIXELS[-1]), strict=True):
        if kind == "clean":
            points = complete_cloud(scene, spacing, bounds)
        else:
            cameras = [
                replace(
                    camera,
                    width=camera.width * scale,
                    height=camera.height * scale,
                    focal_length=camera.focal_length * scale,
                )
                for camera in scene_cameras(scene)
            ]
            seen = camera_clouds(scene, rng, cameras=cameras)
            points = np.vstack([each.world_points() for each in seen])
            points = points[((points >= bounds[0]) & (points <= bounds[1])).all(axis=1)]
        if len(points) >= POINTS:
            return points[np.sort(rng.choice(len(points), POINTS, replace=False))]
    raise ParameterError("points", len(points), f"the scene has not {POINTS} of them in view")
