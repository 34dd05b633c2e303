"""What robots are measured with: a table with things on it within V, and two objects."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from benchmarks.robots.subject import MeasuredRobot
from benchmarks.situations.observing import Observation
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.scenes.clouds import DepthCamera, camera_clouds, complete_cloud
from placement_planner_ros.scenes.primitives import Colour, box, frustum, standing_box
from placement_planner_ros.scenes.scenes import Scene

OBJECTS = ("box", "two boxes")
CLOUDS = ("complete", "one camera")
_THINGS = 6
_HEIGHT = 0.05
"""m above V's lower end, of the table's surface."""
_TRIES = 1000
_ROOM = 0.05
"""m that things keep from the robot and its object at the start: far above the margin of 3 mm and
the camera's noise of 2 mm, so that a start is never refused for a thing."""
_WOOD: Colour = (0.80, 0.68, 0.50)
_THING: Colour = (0.55, 0.60, 0.68)


def boxes_at_start(subject: MeasuredRobot) -> Array:
    """(n, 2, 3) lower and upper ends of boxes that hold each of the robot's shapes at q_0, and the
    object in each grasp.
    """
    robot, q = subject.robot, subject.q_start
    clouds = []
    for thing, T in zip(robot.geometry.geometryObjects, robot.geometry_poses(q), strict=True):
        thing.geometry.computeLocalAABB()
        around = thing.geometry.aabb_local
        clouds.append(
            _corners_of(np.array((around.min_, around.max_))) @ T.rotation.T + T.translation
        )
    for arm in subject.arms:
        tip = robot.link_pose(q, arm.tip_frame)
        for T in (tip * grasp for grasp in arm.grasps):
            clouds.append(subject.vertices @ T.rotation.T + T.translation)
    return np.array([(cloud.min(axis=0), cloud.max(axis=0)) for cloud in clouds])


def _corners_of(ends: Array) -> Array:
    """(8, 3) of a box from its lower and upper ends (2, 3)."""
    x, y, z = ends.T
    return np.stack(np.meshgrid(x, y, z), axis=-1).reshape(-1, 3)


def table_of(
    volume: TargetVolume, rng: np.random.Generator, keep_clear: Array | None = None
) -> Scene:
    """A table a little above the lower end of V, with a few boxes and round things.

    Args:
        keep_clear: (n, 2, 3) boxes from which things stay `_ROOM` away.
    """
    low, high = volume.lower, volume.upper
    top = float(low[2]) + _HEIGHT
    corners = ((*(low[:2] - 0.05), top - 0.03), (*(high[:2] + 0.05), top))
    parts = [box("table", *corners, _WOOD)]
    discs: list[tuple[float, float, float]] = []
    for _ in range(_TRIES):
        if len(discs) == _THINGS:
            break
        size = rng.uniform((0.04, 0.04, 0.05), (0.10, 0.08, 0.16))
        radius = float(np.hypot(size[0], size[1])) / 2.0
        x, y = rng.uniform(low[:2] + radius, high[:2] - radius).tolist()
        if any(np.hypot(x - a, y - b) < radius + r + 0.03 for a, b, r in discs):
            continue
        if keep_clear is not None:
            reach = (radius + _ROOM, radius + _ROOM, _ROOM)
            near = keep_clear[:, 0] < np.add((x, y, top + size[2]), reach)
            near &= keep_clear[:, 1] > np.subtract((x, y, top), reach)
            if near.all(axis=1).any():
                continue
        name = f"thing_{len(discs)}"
        discs.append((x, y, radius))
        if len(discs) % 2:
            yaw = rng.uniform(0.0, np.pi)
            parts.append(standing_box(name, tuple(size), (x, y), yaw, top, _THING))
        else:
            half = float(size[0]) / 2.0
            parts.append(frustum(name, (half, half), (top, top + float(size[2])), _THING, (x, y)))
    return Scene("table", volume, tuple(parts))


def observe(scene: Scene, cloud: str, rng: np.random.Generator) -> Observation:
    """One of `CLOUDS`; what the camera saw, with its lines of sight."""
    if cloud == CLOUDS[0]:
        return Observation(complete_cloud(scene))
    middle = (scene.volume.lower + scene.volume.upper) / 2.0
    eye = np.add(middle, (-0.6, 0.3, 0.7))
    camera = DepthCamera.looking_at("camera", eye, middle)
    seen = camera_clouds(scene, rng, cameras=(camera,))[0].world_points()
    return Observation(seen, (View(seen, eye),))


def outside_boxes(boxes: Array, points: Array, distance: float) -> npt.NDArray[np.bool_]:
    """Which of (n, 3) points are in none of the boxes (k, 2, 3) grown by `distance`, metres."""
    low, high = boxes[:, 0] - distance, boxes[:, 1] + distance
    within = np.logical_and(points[:, None] >= low, points[:, None] <= high)
    return np.logical_not(np.any(np.all(within, axis=2), axis=1))


def object_of(subject: MeasuredRobot, name: str) -> tuple[Array, Array]:
    """Vertices and triangles of one of `OBJECTS`, for the same grasps."""
    if name == OBJECTS[0]:
        return subject.vertices, subject.triangles
    low, high = subject.vertices.min(axis=0), subject.vertices.max(axis=0)
    size, middle = high - low, (low + high) / 2.0
    wide, narrow = size * (1.0, 1.0, 0.5), size * (0.6, 0.6, 0.4)
    beneath, above = np.array((0.0, 0.0, -0.25 * size[2])), np.array((0.0, 0.0, 0.2 * size[2]))
    lower = trimesh.creation.box(wide).apply_translation(np.add(middle, beneath))
    upper = trimesh.creation.box(narrow).apply_translation(np.add(middle, above))
    vertices = np.vstack([lower.vertices, upper.vertices])
    return vertices, np.vstack([lower.faces, upper.faces + len(lower.vertices)])
