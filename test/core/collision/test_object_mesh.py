"""An object in one surface against the same made of convex solids: held, placed, swept."""

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from benchmarks.household import object_by_name
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.primitives import bowl
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm

BOUNDS = np.array([[-1.0, -1.0, -1.0], [1.5, 1.0, 1.0]])
GRASP = pin.SE3(pin.utils.rotate("x", 0.3), np.array([0.0, 0.02, 0.16]))
GREEN = (0.0, 1.0, 0.0)
WALL, HIGH, OUTER = 0.004, 0.055, 0.06


def bowls():
    """A bowl made of convex solids, and as one surface."""
    parts = bowl("bowl", (2 * OUTER, HIGH), (0.0, 0.0, 0.0), GREEN, WALL)
    joined = trimesh.util.concatenate(
        [trimesh.Trimesh(part.vertices, part.triangles, process=False) for part in parts]
    )
    inner = OUTER - WALL
    profile = [(0, 0), (OUTER, 0), (OUTER, HIGH), (inner, HIGH), (inner, WALL), (0, WALL)]
    mesh = trimesh.creation.revolve(np.array(profile, float), sections=24)
    return Body.from_mesh(joined.vertices, joined.faces), Body.from_mesh(mesh.vertices, mesh.faces)


def glasses():
    made = [object_by_name(name) for name in ("wine_glass", "wine_glass_mesh")]
    return tuple(Body.from_mesh(o.vertices, o.triangles, o.center_of_mass) for o in made)


@pytest.fixture(scope="module")
def yumi():
    return load_yumi()


@pytest.fixture(scope="module")
def obstacles():
    points = complete_cloud(scene_by_name("table"), spacing=0.008, bounds=BOUNDS * 0.9)
    return ObstacleSet.from_points(points, GridSettings(cell_size=0.01), bounds=BOUNDS)


@pytest.fixture(scope="module", params=[bowls, glasses])
def both(request):
    solids, mesh = request.param()
    assert solids.mesh is None
    assert len(solids.solids) > 4
    assert mesh.solids == ()
    return solids, mesh


def arm_of(yumi, grasps=(GRASP,)):
    q = yumi.configuration(dict(START_CONFIGURATION))
    return MovingArm(yumi, yumi_arm(yumi, "left", grasps), q)


def compare(first, second):
    """Answers agree, but for what is about as near as the margin; there are some of both."""
    assert (first == second).mean() > 0.99
    assert 0.05 < first.mean() < 0.97


def test_held_it_meets_what_its_solids_meet(yumi, obstacles, both):
    moving = arm_of(yumi)
    solids, mesh = (ArmCollision(moving, AttachedObject(body), obstacles) for body in both)
    rng = np.random.default_rng(0)
    spread = rng.normal(size=(1500, moving.arm.dof)) * 0.5
    Q = np.clip(moving.q + spread, moving.arm.lower, moving.arm.upper)
    only = [
        each.with_pairs(lambda a, b: "the held object" in (a, b)).free_batch(Q)
        for each in (solids, mesh)
    ]
    compare(*only)
    compare(solids.free_batch(Q), mesh.free_batch(Q))
    near = [each.edge_free(moving.q, q) for q in Q[:60] for each in (solids, mesh)]
    assert near[::2] == near[1::2]
    assert 0 < sum(near) < len(near)
