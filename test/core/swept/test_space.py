"""What is swept, against coal at many more configurations; and what counts as news."""

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from helpers.robots import mixed_robot, ring_in

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.swept.space import Stretch, SweptSpace

MARGIN = 0.004
BOX = (0.06, 0.04, 0.03)
HELD = pin.SE3(np.eye(3), np.array([0.05, 0.0, 0.0]))
BOUNDS = np.array([[-1.2, -1.2, -0.8], [1.2, 1.2, 1.2]])
FLOOR = np.stack(np.meshgrid(*[np.arange(-0.6, 0.6, 0.004)] * 2), -1).reshape(-1, 2)


def floor(z, noise=0.0, rng=None):
    points = np.column_stack([FLOOR, np.full(len(FLOOR), z)])
    return points if rng is None else points + rng.normal(0.0, noise, points.shape)


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    return mixed_robot(ring_in(tmp_path_factory.mktemp("meshes")))


@pytest.fixture(scope="module")
def obstacles():
    return ObstacleSet.from_points(floor(-0.5), bounds=BOUNDS)


@pytest.fixture(scope="module")
def holding(robot, obstacles):
    """An arm with a box before its tip."""
    box = trimesh.creation.box(BOX)
    arm = replace(robot.arm("arm", "tip", grasps=[HELD]), touch_links=("ring",))
    moving = MovingArm(robot, arm, np.zeros(4))
    return ArmCollision(moving, AttachedObject(Body.from_mesh(box.vertices, box.faces)), obstacles)


class Path:
    """A curve in joint space, bent, with different speeds."""

    def __init__(self, rng):
        self._ends = rng.uniform(-0.4, 0.4, (3, 4))
        self._ends[:, 2] = rng.uniform(0.0, 0.2, 3)

    def at(self, times):
        t = times[:, None]
        a, b, c = self._ends
        return (1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c

    def dense(self):
        return self.at(np.linspace(0.0, 1.0, 400))


def nearest(robot, points, Q):
    """(n,) how near points come to arm and object at any of Q, by coal."""
    dot = coal.Sphere(1e-9)
    data, places = robot.model.createData(), robot.geometry.createData()
    moving = [k for k, thing in enumerate(robot.geometry.geometryObjects) if thing.parentJoint]
    shapes = [*(robot.geometry.geometryObjects[k].geometry for k in moving), coal.Box(*BOX)]
    best = np.full(len(points), np.inf)
    for q in Q:
        pin.updateGeometryPlacements(robot.model, data, robot.geometry, places, q)
        at = [*(places.oMg[k] for k in moving), robot.link_pose(q, "tip") * HELD]
        for shape, T in zip(shapes, at, strict=True):
            there = coal.Transform3s(T.rotation, T.translation)
            for i, point in enumerate(points):
                here = coal.Transform3s(np.eye(3), point)
                result = coal.DistanceResult()
                coal.distance(dot, here, shape, there, coal.DistanceRequest(), result)
                best[i] = min(best[i], result.min_distance)
    return best


def hits(space, point):
    """Whether some points at one place are told, as a cloud would bring them."""
    cloud = np.repeat(point[None], 5, axis=0)
    news = space.news(cloud)
    return len(news) > 0 and space.first_hit(cloud[news]) is not None


def around(robot, Q, number, rng):
    """Points near what moves, on the way."""
    points = []
    for q in Q[rng.integers(len(Q), size=number)]:
        along = np.array([rng.uniform(0.0, 0.6), 0.0, 0.0])
        points.append(robot.link_pose(q, "fore").act(along + rng.normal(0.0, 0.06, 3)))
    return np.array(points)


@pytest.mark.parametrize("seed", range(2))
def test_every_point_in_the_way_is_told_and_none_that_is_not(robot, holding, obstacles, seed):
    rng = np.random.default_rng(seed)
    path = Path(rng)
    dense = path.dense()
    space = SweptSpace([Stretch("path", holding, dense)], obstacles, MARGIN)
    points = around(robot, dense, 40, rng)
    near = nearest(robot, points, path.at(np.linspace(0.0, 1.0, 600)))
    told = np.array([hits(space, point) for point in points])
    assert told[near < MARGIN].all()
    assert not told[near > MARGIN + 0.003].any()
    assert 5 < told.sum() < 35


def test_where_it_hits_is_told(robot, holding, obstacles):
    dense = Path(np.random.default_rng(1)).dense()
    space = SweptSpace([Stretch("path", holding, dense)], obstacles, MARGIN)
    T = robot.link_pose(dense[len(dense) // 2], "fore")
    point = T.act(np.array([0.1, 0.0, 0.0]))
    hit = space.first_hit(np.repeat(point[None], 5, axis=0))
    assert (hit.stretch, hit.body) == ("path", "fore")
    np.testing.assert_array_equal(hit.point, point)


def test_the_object_may_touch_what_it_comes_to_stand_on(robot, holding, obstacles):
    q = np.zeros((1, 4))
    T = robot.link_pose(q[0], "tip") * HELD
    bottom = T.translation[2] - 0.015
    for contact, inside, told in (
        (-np.inf, 0.001, True),
        (bottom + 0.003, 0.001, False),
        (bottom + 0.003, 0.005, True),
    ):
        stretch = Stretch("approach", holding, q, contact)
        space = SweptSpace([stretch], obstacles, MARGIN)
        assert hits(space, T.act(np.array([0.0, 0.0, inside - 0.015]))) is told


@pytest.mark.parametrize("noise", [0.0, 0.0005, 0.002])
def test_a_surface_that_was_known_is_no_news_however_noisy(holding, noise):
    """The arm brushes the floor with its elbow; other clouds of it, and a floor that has risen."""
    rng = np.random.default_rng(5)
    q = np.zeros((1, 4))
    low = 0.33 - 0.04 - MARGIN - 0.0005
    known = ObstacleSet.from_points(floor(low, noise, rng), bounds=BOUNDS)
    space = SweptSpace([Stretch("path", holding, q)], known, MARGIN)
    for _ in range(5):
        again = floor(low, noise, rng)
        assert space.first_hit(again[space.news(again)]) is None
    risen = floor(low + 0.02, noise, rng)
    # With much noise some of its points come near the end of the upper arm too.
    assert space.first_hit(risen[space.news(risen)]).body in ("fore", "upper")


def test_single_points_are_flying_pixels(robot, holding, obstacles):
    dense = Path(np.random.default_rng(2)).dense()
    space = SweptSpace([Stretch("path", holding, dense)], obstacles, MARGIN)
    T = robot.link_pose(dense[0], "fore")
    inside = T.act(np.array([0.1, 0.0, 0.0]))
    apart = np.array([T.act(np.array([x, 0.0, 0.0])) for x in np.arange(0.02, 0.2, 0.02)])
    assert len(space.news(apart)) == len(apart) > 5
    near = inside + 0.004 * np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0]])
    assert space.first_hit(inside[None]) is None
    assert space.first_hit(apart) is None
    assert space.first_hit(near[:2]) is None
    assert space.first_hit(near) is not None
    # Where the cloud has hardly more than one in each cell, all there is is single points.
    sparse = SweptSpace([Stretch("path", holding, dense)], obstacles, MARGIN, density=1.5)
    assert sparse.first_hit(inside[None]) is not None


def test_a_path_that_stands_still_is_swept_too(robot, holding, obstacles):
    q = np.array([[0.3, 0.1, 0.05, 0.0]])
    for still in (q, np.repeat(q, 7, axis=0)):
        space = SweptSpace([Stretch("release", holding, still)], obstacles, MARGIN)
        assert hits(space, robot.link_pose(q[0], "fore").act(np.array([0.1, 0.0, 0.0])))
