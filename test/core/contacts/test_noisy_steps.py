"""Steps of some noise in height: a camera's points are smoothed over them, heights are exact."""

import numpy as np
import pytest
import trimesh
from helpers.footholds import bare_problem
from helpers.pose_sets import placement_pose

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import Contact, TargetVolume

VOLUME = TargetVolume([0.4, -0.15, -0.02], [0.6, 0.15, 0.02])
NOISE = 0.0012
SIZE = (0.09, 0.06, 0.04)
AT, STEP = 0.5, 0.0027
"""x of the step, and its height: less than contact_tolerance."""


def environment(step, rng):
    """Of a table that rises by `step` at x = `AT`, as seen from above."""
    x, y = np.meshgrid(np.arange(0.3, 0.7, 0.0025), np.arange(-0.25, 0.25, 0.0025))
    points = np.column_stack([x.ravel(), y.ravel(), np.where(x.ravel() < AT, 0.0, step)])
    points[:, :2] += rng.uniform(0.0, 0.001, points[:, :2].shape)
    points[:, 2] += rng.normal(0.0, NOISE, len(points))
    return Environment.from_points(points, VOLUME, bounds=(VOLUME.lower - 0.3, VOLUME.upper + 0.3))


def standing(support, around, heights, rng, count=400):
    """(n,) which of random poses of a box are free and stand, and (n, 2) where they end along x."""
    mesh = trimesh.creation.box(SIZE)
    body = Body.from_mesh(mesh.vertices, mesh.faces)
    settings = PlannerSettings(support=support)
    poses = PoseConstraints(bare_problem(body, around), settings.collision, settings.footing, 0.0)
    down = next(k for k, face in enumerate(poses.problem.body.faces) if face.normal[2] < -0.99)
    face = poses.problem.body.faces[down]
    stands, ends = [], []
    for _ in range(count):
        at = np.array([rng.uniform(0.44, 0.56), rng.uniform(-0.1, 0.1), rng.choice(heights)])
        T = placement_pose(face, at, rng.uniform(0.0, 2.0 * np.pi))
        x = (face.vertices @ T.rotation.T + T.translation)[:, 0]
        stands.append(poses.stable(T, down) and poses.free(T, Contact(down, at[2])))
        ends.append((x.min(), x.max()))
    return np.array(stands), np.array(ends)


@pytest.mark.parametrize(("support", "share"), [("vertices", 0.03), ("polygon", 0.7)])
def test_little_stands_across_a_step_of_less_than_three_times_the_noise(support, share):
    rng = np.random.default_rng(3)
    around = environment(STEP, rng)
    assert 0.5 * NOISE < around.measured.noise < 1.5 * NOISE
    stands, ends = standing(support, around, (0.0, STEP), rng)
    across = (ends[:, 0] < AT - 0.010) & (ends[:, 1] > AT + 0.010)
    over = across & (ends.mean(axis=1) < AT - 0.010)
    assert over.sum() > 30
    assert stands[over].mean() < share


@pytest.mark.parametrize("support", ["vertices", "polygon"])
def test_where_there_is_no_step_noise_costs_next_to_nothing(support):
    rng = np.random.default_rng(3)
    stands, _ = standing(support, environment(0.0, rng), (0.0,), rng)
    assert stands.mean() > 0.97
