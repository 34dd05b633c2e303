"""Convex covers hold all of a mesh, and reach no further beyond it than they say."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull, cKDTree

from placement_planner_ros.core import disk_cache
from placement_planner_ros.core.body import convex_cover as convex_cover_module
from placement_planner_ros.core.body import covered_mesh, mesh_components
from placement_planner_ros.core.body.convex_cover import Cover, convex_cover, hull_cover
from placement_planner_ros.core.body.mesh import volumes
from placement_planner_ros.core.body.mesh_components import Components
from placement_planner_ros.core.body.polytope import grown, holds, hull_around


def cross():
    """Three bars through a common middle: the cuts meet inside the solid."""
    bars = [trimesh.creation.box(np.roll((0.3, 0.08, 0.08), k)) for k in range(3)]
    return trimesh.util.concatenate(bars)


def flipped(mesh):
    faces = mesh.faces.copy()
    faces[::3] = faces[::3, ::-1]
    return trimesh.Trimesh(mesh.vertices, faces, process=False)


def needle():
    return trimesh.Trimesh([[0, 0, 0], [0.3, 0, 0], [0.15, 1e-9, 0]], [[0, 1, 2]], process=False)


def screws():
    return trimesh.util.concatenate(
        [
            trimesh.creation.cylinder(0.002, 0.008, sections=6).apply_translation([x, y, 0.0])
            for x in np.linspace(0, 0.15, 6)
            for y in np.linspace(0, 0.1, 5)
        ]
    )


def scan():
    """More triangles than cuts are looked for in, each vertex a little off."""
    ring = trimesh.creation.torus(0.06, 0.02, major_sections=160, minor_sections=80)
    along = np.random.default_rng(2).normal(scale=2e-4, size=(len(ring.vertices), 1))
    vertices = ring.vertices + along * ring.vertex_normals
    return trimesh.Trimesh(vertices, ring.faces, process=False)


RING = trimesh.creation.annulus(0.05, 0.07, 0.04, sections=24)
MESHES = {
    "ring": (RING, True),
    "inside out": (trimesh.Trimesh(RING.vertices, RING.faces[:, ::-1], process=False), True),
    "some turned": (flipped(RING), True),
    "cross": (cross(), True),
    "open": (trimesh.Trimesh(RING.vertices, RING.faces[5:], process=False), False),
    "screws": (screws(), True),
    "plate": (trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), False),
    "needle": (needle(), False),
    "scan": (scan(), True),
}


def inside(cover, points):
    found = np.zeros(len(points), bool)
    for part in cover.parts:
        planes = ConvexHull(part).equations
        found |= (points @ planes[:, :3].T + planes[:, 3] <= 0.0).all(axis=1)
    return found


def on_triangles(mesh, count, rng):
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    weights = rng.dirichlet((0.7, 0.7, 0.7), count)
    return np.einsum("nk,nki->ni", weights, corners[rng.integers(len(corners), size=count)])


@pytest.mark.parametrize("name", MESHES)
def test_a_cover_holds_the_mesh_and_the_solid_inside_and_not_much_more(name):
    mesh, closed = MESHES[name]
    rng = np.random.default_rng(1)
    cover = convex_cover(np.asarray(mesh.vertices), np.asarray(mesh.faces), 0.01)
    assert cover.closed is closed
    points = on_triangles(mesh, 20_000, rng)
    assert inside(cover, points).all()
    parts = Components.of(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    low, high = np.asarray(mesh.vertices).min(axis=0), np.asarray(mesh.vertices).max(axis=0)
    box = rng.uniform(low, high, (3_000, 3))
    solid = box[parts.inside(box)]
    assert inside(cover, solid).all()
    sample = np.concatenate([on_triangles(mesh, 100_000, rng), solid])
    held = np.concatenate(
        [rng.dirichlet(np.full(len(part), 1.0 / len(part)), 500) @ part for part in cover.parts]
    )
    away = cKDTree(sample).query(held)[0]
    enclosed = parts.inside(held)
    assert away[~enclosed].max() <= cover.excess + 0.002
    assert cover.excess < 0.02


def test_scans_are_cut_by_what_a_rougher_mesh_shows(monkeypatch):
    mesh = scan()
    given = np.asarray(mesh.vertices), np.asarray(mesh.faces), 0.01
    assert len(mesh.faces) > convex_cover_module._MANY
    rough = convex_cover(*given)
    monkeypatch.setattr(convex_cover_module, "_MANY", len(mesh.faces))
    close = convex_cover(*given)
    assert not np.array_equal(rough.parts[0], close.parts[0])
    assert len(rough.parts) <= 1.5 * len(close.parts)
    assert rough.excess <= 1.2 * close.excess


def test_what_is_smaller_than_the_cubes_of_a_rougher_mesh_is_covered_too(monkeypatch):
    monkeypatch.setattr(convex_cover_module, "_MANY", 0)
    nut = trimesh.creation.box((0.002, 0.002, 0.002)).apply_translation([0.022, 0.002, 0.002])
    ring = trimesh.creation.annulus(0.005, 0.008, 0.004, sections=12)
    mesh = trimesh.util.concatenate([ring, nut])
    cover = convex_cover(np.asarray(mesh.vertices), np.asarray(mesh.faces), 0.005)
    assert inside(cover, np.asarray(mesh.vertices)).all()
    assert cover.excess < 0.008


@pytest.mark.parametrize("name", ["ring", "inside out", "some turned", "cross", "screws", "scan"])
def test_a_ray_and_solid_angles_agree_on_what_is_inside(name):
    """Beside triangles, along edges and on axes of symmetry too, where the ray leaves it open."""
    mesh = MESHES[name][0]
    parts = Components.of(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    solids, rng = parts._solids, np.random.default_rng(3)
    low, high = parts.corners.min(axis=(0, 1)), parts.corners.max(axis=(0, 1))
    up = np.linalg.inv(mesh_components._ASKEW)[2]
    below = parts.corners[rng.integers(len(parts.corners), size=60)]
    edges = below[:, 0] + rng.random((60, 1)) * (below[:, 1] - below[:, 0])
    beside = on_triangles(mesh, 200, rng) + rng.normal(scale=1e-4, size=(200, 3))
    points = np.concatenate([rng.uniform(low, high, (300, 3)), beside, edges - 0.003 * up])
    angles = [mesh_components._solid_angles(parts.corners - point) for point in points]
    turns = np.array([np.bincount(parts.label, each) for each in angles]) / (4.0 * np.pi)
    expected = (np.abs(turns) > 0.5).any(axis=1)
    assert (parts.inside(points) == expected).all()
    assert expected.any()
    assert not expected.all()
    clear = [solids._crossed(point) is not None for point in points @ mesh_components._ASKEW]
    assert not any(clear[-60:])
    assert all(clear[:300])


def test_what_is_not_in_a_hull_is_not_proven_to_be():
    part = grown(hull_around(np.asarray(trimesh.creation.box((1, 1, 1)).vertices)))
    corner = np.full((1, 3), 0.5)
    assert holds(part, corner)
    assert not holds(part, corner + 1e-5)


def test_the_hull_stands_in():
    cover = hull_cover(np.asarray(RING.vertices), np.asarray(RING.faces))
    assert len(cover.parts) == 1
    assert inside(cover, np.asarray(RING.vertices)).all()
    assert cover.excess >= 0.05  # the middle of the hole


@pytest.fixture
def own_cache(monkeypatch, tmp_path):
    monkeypatch.setattr(disk_cache, "cache_folder", lambda: tmp_path)


def ask(made, tolerance=0.01):
    vertices, faces = np.asarray(RING.vertices), np.asarray(RING.faces)
    parts = (np.eye(4, 3), np.eye(5, 3))

    def make():
        made.append(tolerance)
        return Cover(parts, 0.25, True)

    cover = covered_mesh.kept_cover(vertices, faces, tolerance, make)
    assert [part.shape for part in cover.parts] == [(4, 3), (5, 3)]
    assert (cover.excess, cover.closed) == (0.25, True)
    return made


def test_a_cover_of_an_object_that_takes_too_long_is_the_hull_from_then_on(own_cache, monkeypatch):
    mesh = np.asarray(RING.vertices), np.asarray(RING.faces), 0.01
    with monkeypatch.context() as soon:
        soon.setattr(covered_mesh, "MOST_SECONDS", 0.0)
        (part,) = covered_mesh.make_cover(*mesh).parts
    np.testing.assert_array_equal(hull_cover(*mesh[:2]).parts[0], part)
    assert len(covered_mesh.make_cover(*mesh).parts) == 1
    assert len(covered_mesh.make_cover(*mesh[:2], 0.02).parts) > 1


def test_rows_that_are_alike_are_found_as_numpy_finds_them():
    rng = np.random.default_rng(2)
    rows = rng.integers(-2, 3, (500, 3)).astype(float)
    rows[::3, 0] = rng.normal(size=167)
    _, first, kind = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    made = mesh_components.alike(rows)
    np.testing.assert_array_equal(made[0], first)
    np.testing.assert_array_equal(made[1], kind.reshape(-1))


def test_triangles_that_repeat_are_left_out_and_those_that_disagree_are_turned():
    box = trimesh.creation.box((0.1, 0.06, 0.04))
    faces = np.array(box.faces)
    faces[[2, 7]] = faces[[2, 7]][:, ::-1]
    again = np.vstack([faces[3:5, [1, 2, 0]], faces])
    made = Components.of(np.asarray(box.vertices), again)
    assert made.closed.all()
    assert made.rows.tolist() == [0, 1, 2, 3, 4, *range(7, 14)]
    assert abs(volumes(made.corners).sum()) == pytest.approx(box.volume)
    assert not Components.of(np.asarray(box.vertices), again[:-1]).closed.any()


def test_a_cover_is_made_once_for_a_content(own_cache):
    made = ask(ask([]))
    assert made == [0.01]
    assert ask(made, 0.02) == [0.01, 0.02]
