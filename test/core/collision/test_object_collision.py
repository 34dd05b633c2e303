"""c_f: the swept object against coal on every part and box, and what counts as support."""

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from benchmarks.household import object_by_name
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision import object as object_collision
from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.collision.object import ObjectCollision
from placement_planner_ros.core.collision.swept_object import swept_object
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.scenes import scene_by_name

BOUNDS = np.array([[-1.0, -1.0, -1.0], [1.5, 1.0, 1.0]])
CUBE = 0.1


def block(lower, upper, spacing=0.005):
    """Points on an axis-aligned box."""
    lower, upper = np.array(lower), np.array(upper)
    axes = [
        np.linspace(a, b, int((b - a) / spacing) + 2) for a, b in zip(lower, upper, strict=True)
    ]
    points = np.array(np.meshgrid(*axes, indexing="ij")).reshape(3, -1).T
    return points[((points == lower) | (points == upper)).any(axis=1)]


def obstacles_of(*clouds):
    return ObstacleSet.from_points(np.vstack(clouds), GridSettings(cell_size=0.01), bounds=BOUNDS)


TABLE = block((-0.4, -0.4, -0.05), (0.4, 0.4, 0.0))


@pytest.fixture(scope="module")
def cube():
    mesh = trimesh.creation.box((CUBE, CUBE, CUBE))
    return Body.from_mesh(mesh.vertices, mesh.faces)


def standing(x=0.0, y=0.0, z=0.0):
    return pin.SE3(np.eye(3), np.array([x, y, z + CUBE / 2])).homogeneous


def reference(parts, obstacles, T, contact, raised, settings):
    """coal on the sweep of every convex part against every box that is not support."""
    request = coal.CollisionRequest()
    request.security_margin = settings.collision_margin + settings.approach_stray
    keep = np.abs(obstacles.upper[:, 2] - contact) > settings.contact_tolerance
    at = coal.Transform3s(T[:3, :3], T[:3, 3])
    for part in parts:
        up = T[2, :3] * raised
        corners = np.vstack([part.vertices, part.vertices + up])
        hull = trimesh.convex.convex_hull(corners)
        points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for vertex in hull.vertices:
            points.append(vertex)
        for face in hull.faces:
            faces.append(coal.Triangle(*map(int, face)))
        shape = coal.Convex(points, faces)
        world = corners @ T[:3, :3].T + T[:3, 3]
        near = keep & (obstacles.lower < world.max(axis=0) + 0.01).all(axis=1)
        near &= (obstacles.upper > world.min(axis=0) - 0.01).all(axis=1)
        for i in np.flatnonzero(near):
            lower, upper = obstacles.lower[i], obstacles.upper[i]
            box = coal.Transform3s(np.eye(3), (lower + upper) / 2)
            if coal.collide(
                shape, at, coal.Box(upper - lower), box, request, coal.CollisionResult()
            ):
                return False
    return True


@pytest.mark.parametrize(
    ("scene", "thing"),
    [
        ("cabinet_high_clutter", "wine_glass"),
        ("table", "toy_table"),
        ("table", "large_crayons_box"),
        ("cabinet_high_clutter", "wine_glass_mesh"),
        ("table", "toy_table_mesh"),
    ],
)
def test_agrees_with_coal(scene, thing):
    made = object_by_name(thing)
    body = Body.from_mesh(made.vertices, made.triangles, made.center_of_mass)
    world = scene_by_name(scene)
    obstacles = obstacles_of(complete_cloud(world, spacing=0.008, bounds=BOUNDS * 0.9))
    settings = CollisionSettings()
    checker = ObjectCollision(body, obstacles, settings)
    rng = np.random.default_rng(1)
    floor = 0.0 if scene == "table" else 0.176
    poses, raised = [], []
    corners = np.vstack([part.vertices for part in made.parts])
    for i in range(90):
        R = pin.utils.rotate("z", rng.uniform(-3, 3))
        if i % 2:
            R = R @ pin.exp3(rng.normal(size=3))
        xy = rng.uniform(world.volume.lower[:2], world.volume.upper[:2])
        z = floor - (corners @ R.T)[:, 2].min()
        poses.append(pin.SE3(R, np.array([*xy, z])).homogeneous)
        raised.append(rng.choice([0.0, 0.02, 0.1]))
    expected = np.array(
        [
            reference(made.parts, obstacles, T, floor, up, settings)
            for T, up in zip(poses, raised, strict=True)
        ]
    )
    assert 0.1 < expected.mean() < 0.9
    assert (checker.free_at(np.array(poses), floor, raised) == expected).all()
    single = [checker.free(T, floor, up) for T, up in zip(poses[:50], raised, strict=False)]
    assert single == expected[:50].tolist()


def test_stands_on_its_support_but_not_on_lower_or_higher_cells(cube):
    checker = ObjectCollision(cube, obstacles_of(TABLE))
    assert checker.free(standing(), 0.0, 0.05)
    # The same pose, said to stand elsewhere: the table is an obstacle then.
    assert not checker.free(standing(), 0.01, 0.05)
    assert not checker.free(standing(), -0.01, 0.05)
    assert checker.free(standing(z=0.0033), 0.01, 0.05)
    assert not checker.free(standing(z=0.0031), 0.01, 0.05)


def test_support_ends_at_the_contact_tolerance(cube):
    step = block((0.0, -0.4, -0.05), (0.4, 0.4, 0.002))
    obstacles = obstacles_of(block((-0.4, -0.4, -0.05), (-0.005, 0.4, 0.0)), step)
    wide = ObjectCollision(cube, obstacles, CollisionSettings(contact_tolerance=0.0025))
    tight = ObjectCollision(cube, obstacles, CollisionSettings(contact_tolerance=0.0015))
    assert wide.free(standing(), 0.0, 0.05)
    assert not tight.free(standing(), 0.0, 0.05)


def test_what_lies_beneath_need_not_be_farther_by_what_is_strayed_sideways(cube):
    """An object overhangs what ends just below its contact plane."""
    settings = CollisionSettings(contact_tolerance=0.001)
    for below, free in ((0.0033, True), (0.0031, True), (0.0029, False), (0.0009, True)):
        obstacles = obstacles_of(TABLE - [0.0, 0.0, below])
        overhanging = ObjectCollision(cube, obstacles, settings, overhangs=True)
        assert overhanging.free(standing(), 0.0, 0.05) == free
        plain = ObjectCollision(cube, obstacles, settings)
        assert plain.free(standing(), 0.0, 0.05) == (free and below != 0.0031)


def test_checks_the_way_down(cube):
    shelf = block((-0.1, -0.1, 0.15), (0.1, 0.1, 0.16))
    obstacles, balls = obstacles_of(TABLE, shelf), swept_object(cube)[0].balls.copy()
    checker = ObjectCollision(cube, obstacles)
    assert checker.free(standing(), 0.0, 0.0)
    assert checker.free(standing(), 0.0, 0.15 - CUBE - 0.004)
    assert not checker.free(standing(), 0.0, 0.15 - CUBE - 0.002)
    assert not checker.free(standing(), 0.0, 0.2)
    # A bar narrower than the gap between any two samples of the way.
    bar = obstacles_of(TABLE, block((-0.3, 0.0, 0.3), (0.3, 0.0005, 0.3005), 0.002))
    assert not ObjectCollision(cube, bar).free(standing(), 0.0, 0.4)
    assert (swept_object(cube)[0].balls == balls).all(), "checkers share nothing that they change"


def test_far_from_everything_and_in_an_empty_world(cube):
    assert ObjectCollision(cube, obstacles_of(TABLE)).free(standing(5.0, 5.0, 5.0), 5.0, 0.1)
    empty = ObstacleSet.from_points(np.zeros((0, 3)), bounds=BOUNDS)
    assert ObjectCollision(cube, empty).free(standing(), 0.0, 0.1)
    assert ObjectCollision(cube, empty).free_at(np.zeros((0, 4, 4)), 0.0, 0.1).shape == (0,)


def test_what_is_not_certain_is_not_free(cube, monkeypatch):
    checker = ObjectCollision(cube, obstacles_of(TABLE))
    poses = np.array([standing(x) for x in (0.0, 0.1)])
    assert checker.free_at(poses, 0.0, 0.05).all()

    def undecided(*arguments):
        arguments[-1][:] = False

    monkeypatch.setattr(object_collision, "check_poses", undecided)
    assert not checker.free_at(poses, 0.0, 0.05).any()
    assert not checker.free(poses[0], 0.0, 0.05)


def test_it_is_never_free_nearer_than_the_margin(cube):
    """Turned by odd angles, a corner before a wall: its distance is known in closed form."""
    wall = block((0.2, -0.3, 0.05), (0.25, 0.3, 0.3))
    obstacles = obstacles_of(wall)
    checker = ObjectCollision(cube, obstacles)
    face = obstacles.lower[:, 0].min()
    corners = cube.parts[0].vertices
    kept = CollisionSettings().collision_margin + CollisionSettings().approach_stray
    rng = np.random.default_rng(0)
    for _ in range(200):
        R = pin.exp3(rng.normal(size=3))
        for missing, free in ((-1e-7, False), (-2e-6, False), (3e-6, True)):
            x = face - (corners @ R.T)[:, 0].max() - kept - missing
            T = pin.SE3(R, np.array([x, 0.0, 0.17])).homogeneous
            assert checker.free(T, -1.0, 0.0) == free


def bowl(thick=0.004, sides=48):
    """A hollow bowl, upside down: 160 mm across, 60 mm high, open below, one closed surface."""
    outer, inner, high = 0.08, 0.08 - thick, 0.06
    profile = [(0.0, high - thick), (inner, high - thick), (inner, 0.0), (outer, 0.0)]
    profile += [(outer, high), (0.0, high)]
    mesh = trimesh.creation.revolve(np.array(profile), sections=sides)
    assert mesh.is_volume
    return Body.from_mesh(mesh.vertices, mesh.faces)


def test_a_bowl_goes_over_what_stands_inside_and_not_through_it():
    body = bowl()
    assert body.warnings == ()
    low = obstacles_of(TABLE, block((-0.02, -0.02, 0.0), (0.02, 0.02, 0.045)))
    high = obstacles_of(TABLE, block((-0.02, -0.02, 0.0), (0.02, 0.02, 0.058)))

    def at(x, y=0.0):
        return pin.SE3(np.eye(3), np.array([x, y, 0.0])).homogeneous

    over = ObjectCollision(body, low)
    assert over.free(at(0.0), 0.0, 0.1)
    assert over.free(at(0.03, 0.02), 0.0, 0.1)
    for angle in np.linspace(0.0, 6.0, 13):  # on the wall
        assert not over.free(at(0.078 * np.cos(angle), 0.078 * np.sin(angle)), 0.0, 0.1)
    assert over.free(at(0.11), 0.0, 0.1)
    assert not ObjectCollision(body, high).free(at(0.0), 0.0, 0.1)


def test_what_lies_wholly_inside_the_solid_of_a_mesh_collides():
    ring = trimesh.creation.annulus(r_min=0.05, r_max=0.15, height=0.2)
    body = Body.from_mesh(ring.vertices, ring.faces)
    grain = obstacles_of(block((0.099, -0.001, 0.0), (0.101, 0.001, 0.002), 0.001))
    hole = obstacles_of(block((-0.001, -0.001, 0.0), (0.001, 0.001, 0.002), 0.001))
    T = np.eye(4)
    for raised in (0.0, 0.01):
        assert not ObjectCollision(body, grain).free(T, -1.0, raised)
        assert ObjectCollision(body, hole).free(T, -1.0, raised)
    # on its way down it passes over the grain
    T[2, 3] = -0.15
    assert ObjectCollision(body, grain).free(T, -1.0, 0.0)
    assert not ObjectCollision(body, grain).free(T, -1.0, 0.2)
