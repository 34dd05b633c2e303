"""Support by polygon on thin bars of which a noisy camera sees a point or two across."""

import numpy as np
import pytest
import trimesh
from helpers.footholds import VOLUME, Block, bare_problem, spare
from helpers.pose_sets import placement_pose

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.freespace import View

POLYGON = PlannerSettings(support="polygon")
SENSOR = np.array([0.35, 0.05, 0.8])
PIXEL = 0.0025
BARS = [Block(f"bar {k}", (x, x + 0.005), (-0.12, 0.12)) for k, x in enumerate(
    0.4 + 0.019 * np.arange(11)
)]  # fmt: skip


def seen(noise, rng):
    """(n, 3) bars, and a floor 80 mm below that shows through, as a camera sees them."""
    x, y = np.meshgrid(np.arange(0.25, 0.75, PIXEL), np.arange(-0.25, 0.25, PIXEL))
    xy = np.column_stack([x.ravel(), y.ravel()]) + rng.uniform(0.0, PIXEL, 2)
    on_bar = np.zeros(len(xy), np.bool_)
    for bar in BARS:
        on_bar |= (xy[:, 0] >= bar.x[0]) & (xy[:, 0] <= bar.x[1]) & (np.abs(xy[:, 1]) <= bar.y[1])
    points = np.column_stack([xy, np.zeros(len(xy))])
    share = (SENSOR[2] + 0.08) / SENSOR[2]
    points[~on_bar] = SENSOR + share * (points[~on_bar] - SENSOR)
    rays = points - SENSOR
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    return points + rays * rng.normal(0.0, noise, len(points))[:, None]


@pytest.mark.parametrize("noise", [0.0013, 0.0018])
def test_a_box_stands_where_bars_truly_carry_it_and_nowhere_else(noise):
    rng = np.random.default_rng(4)
    mesh = trimesh.creation.box((0.14, 0.06, 0.06))
    body = Body.from_mesh(mesh.vertices, mesh.faces)
    points = seen(noise, rng)
    bounds = VOLUME.lower - 0.4, VOLUME.upper + 0.4
    sights = [View(points, SENSOR)]
    environment = Environment.from_points(points, VOLUME, bounds=bounds, sights=sights)
    poses = PoseConstraints(
        bare_problem(body, environment), POLYGON.collision, POLYGON.footing, 0.0
    )
    assert environment.measured.noise > 0.5 * noise
    face = next(k for k, f in enumerate(body.faces) if f.normal[2] < -0.99)
    resting = body.faces[face]
    stood, safe = 0, []
    for _ in range(200):
        # also beyond the ends of the bars
        at = np.array([rng.uniform(0.38, 0.62), rng.uniform(-0.18, 0.18), 0.0])
        T = placement_pose(poses.problem.body.faces[face], at, rng.uniform(0.0, 2.0 * np.pi))
        patch = (resting.vertices @ T.rotation.T + T.translation)[:, :2]
        center = T.act(body.center_of_mass)
        inside, _ = spare([patch], BARS, center[:2], center[2])
        stands = poses.stable(T, face)
        stood += stands
        assert not stands or inside > POLYGON.support_margin
        if inside > 0.02:
            safe.append(stands)
    assert 20 < stood < 180
    assert np.mean(safe) > 0.5
