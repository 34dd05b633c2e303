"""Convex covers hold all of a mesh, and reach no further beyond it than they say."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull, cKDTree

from placement_planner_ros.core import disk_cache
from placement_planner_ros.core.body import covered_mesh
from placement_planner_ros.core.body.convex_cover import convex_cover


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
    """Many triangles, each vertex a little off."""
    ring = trimesh.creation.torus(0.06, 0.02, major_sections=100, minor_sections=50)
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


def winds_about(mesh, points):
    """Which points (n, 3) the triangles of a mesh surround, by the angles that they are seen in."""
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.faces)]
    found = []
    for point in points:
        a, b, c = (corners - point).transpose(1, 0, 2)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        volume = (a * np.cross(b, c)).sum(1)
        below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        found.append(abs(np.arctan2(volume, below).sum()) > np.pi)
    return np.array(found)


def inside(cover, points):
    found = np.zeros(len(points), bool)
    for part in cover.parts:
        planes = ConvexHull(part.vertices).equations
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
    cover = convex_cover(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    assert cover.closed is closed
    points = on_triangles(mesh, 20_000, rng)
    assert inside(cover, points).all()
    low, high = np.asarray(mesh.vertices).min(axis=0), np.asarray(mesh.vertices).max(axis=0)
    solid = rng.uniform(low, high, (300, 3))
    if name == "some turned":
        solid = solid[winds_about(RING, solid)]
    else:
        solid = solid[winds_about(mesh, solid)] if closed else solid[:0]
    assert inside(cover, solid).all()
    sample = on_triangles(mesh, 100_000, rng)
    held = np.concatenate(
        [
            rng.dirichlet(np.full(len(points), 1.0 / len(points)), 200) @ points
            for points in (part.vertices for part in cover.parts)
        ]
    )
    away = cKDTree(sample).query(held)[0]
    far = held[away > cover.excess + 0.002]
    assert winds_about(RING if name == "some turned" else mesh, far).all()
    assert cover.excess < 0.02


def test_a_mug_keeps_its_opening():
    """Parts leave the inside free from a tolerance beside the walls on."""
    outer, inner = trimesh.creation.cylinder(0.04, 0.1), trimesh.creation.cylinder(0.036, 0.1)
    inner.apply_translation([0.0, 0.0, 0.004])
    inner.invert()
    mug = trimesh.util.concatenate([outer, inner])
    keep = mug.triangles_center[:, 2] < 0.0499
    mug = trimesh.Trimesh(mug.vertices, mug.faces[keep], process=False)
    cover = convex_cover(np.asarray(mug.vertices), np.asarray(mug.faces))
    assert inside(cover, on_triangles(mug, 5_000, np.random.default_rng(4))).all()
    axis = np.column_stack([np.zeros((20, 2)), np.linspace(-0.035, 0.05, 20)])
    assert not inside(cover, axis).any()
    assert cover.excess < 0.011


@pytest.fixture
def own_cache(monkeypatch, tmp_path):
    monkeypatch.setattr(disk_cache, "cache_folder", lambda: tmp_path)


def test_a_cover_of_an_object_is_kept(own_cache):
    mesh = np.asarray(RING.vertices), np.asarray(RING.faces)
    first = covered_mesh.kept_cover(*mesh).parts
    again = covered_mesh.kept_cover(*mesh, lambda *_: pytest.fail("made again")).parts
    assert len(first) == len(again) > 1
