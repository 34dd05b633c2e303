"""The grasped object: parts, placement faces, B_o, and meshes that are not what they should be."""

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.convex_cover import hull_cover
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.scenes.objects import object_by_name


def body_of(mesh, **options):
    return Body.from_mesh(mesh.vertices, mesh.faces, **options)


def bundled(name):
    thing = object_by_name(name)
    return Body.from_mesh(thing.vertices, thing.triangles, thing.center_of_mass)


def box(*size):
    return trimesh.creation.box(size)


@pytest.mark.parametrize(
    ("name", "count"),
    [("large_crayons_box", 6), ("small_crayons_box", 6), ("wine_glass", 2), ("toy_table", 6)],
)
def test_bundled_objects_have_the_faces_a_person_would_name(name, count):
    body = bundled(name)
    assert len(body.faces) == count
    assert body.warnings == ()
    assert [f.area for f in body.faces] == sorted((f.area for f in body.faces), reverse=True)


def test_a_low_center_of_mass_is_needed_to_stand():
    rod = box(0.015, 0.015, 0.3)
    assert len(body_of(rod).faces) == 4
    ends = body_of(rod, center_of_mass=(0.0, 0.0, -0.13)).faces
    assert any(face.normal[2] < -0.9 for face in ends)
    assert not any(face.normal[2] > 0.9 for face in ends)
    aside = body_of(box(0.1, 0.1, 0.1), center_of_mass=(0.047, 0.0, 0.0))
    assert {tuple(np.round(f.normal)) for f in aside.faces} == {(1, 0, 0), (-1, 0, 0)}


def test_thin_walls_that_reach_into_each_other_have_the_centre_of_their_union():
    """Walls of 0.6 mm, which cells of 1.3 mm could not tell."""
    walls = box(0.2, 0.2, 0.0006), box(0.0006, 0.2, 0.15)
    walls[1].apply_translation([0.05, 0.0, 0.0747])
    pieces = [(0.2 * 0.0006, (0.0, 0.0)), (0.0006 * 0.15, (0.05, 0.0747))]
    pieces.append((-0.0006 * 0.0006, (0.05, 0.0)))  # what they share
    area = sum(size for size, _ in pieces)
    x, z = (sum(size * at[k] for size, at in pieces) / area for k in range(2))
    body = body_of(trimesh.util.concatenate(walls))
    np.testing.assert_allclose(body.center_of_mass, [x, 0.0, z], atol=2e-4)


def test_volume_points_fill_the_union_of_overlapping_pieces():
    a, b = box(0.1, 0.1, 0.1), box(0.1, 0.1, 0.1)
    b.apply_translation([0.05, 0.0, 0.0])
    body = body_of(trimesh.util.concatenate([a, b]))
    assert len(body.volume_points) * 0.005**3 == pytest.approx(0.15 * 0.01, rel=0.01)
    np.testing.assert_allclose(body.center_of_mass, [0.025, 0.0, 0.0], atol=1e-6)
    assert len(body.parts) == 2
    hollow = bundled("toy_table")
    inside = np.zeros(len(hollow.volume_points), bool)
    for part in hollow.parts:
        inside |= (hollow.volume_points @ part.normals.T <= part.offsets + 1e-9).all(axis=1)
    assert inside.all()


@pytest.mark.parametrize("between", [True, False], ids=["by pairs", "one after the other"])
def test_a_mesh_of_fronts_and_backs_is_the_solid_that_its_fronts_enclose(between):
    cup = trimesh.creation.revolve(
        [(0, 0), (0.03, 0), (0.03, 0.08), (0.027, 0.08), (0.027, 0.003), (0, 0.003)], sections=12
    )
    front, back = cup.faces, cup.faces[:, ::-1]
    both = np.stack([front, back], axis=1 if between else 0).reshape(-1, 3)
    made, right = (
        Body.from_mesh(cup.vertices, both, cover=hull_cover),
        body_of(cup, cover=hull_cover),
    )
    assert made.warnings == right.warnings
    np.testing.assert_allclose(made.center_of_mass, right.center_of_mass, atol=1e-9)
    np.testing.assert_array_equal(made.volume_points, right.volume_points)


def test_an_open_mesh_counts_as_a_sheet_and_says_so():
    mesh = box(0.1, 0.06, 0.04)
    body = Body.from_mesh(mesh.vertices, mesh.faces[:-2])
    assert any("not closed" in warning for warning in body.warnings)
    assert len(body.faces) == 6
    np.testing.assert_allclose(body.center_of_mass, 0.0, atol=1e-12)
    # voxels of five walls of six, and none inside
    depth = (np.array([0.05, 0.03, 0.02]) - np.abs(body.volume_points)).min(axis=1)
    assert depth.max() < 0.005
    assert 600 < len(body.volume_points) < 900
    assert not body.mesh.cover.closed


def test_a_piece_that_is_not_convex_is_what_its_triangles_are():
    ring = trimesh.creation.annulus(r_min=0.03, r_max=0.05, height=0.02)
    body = body_of(ring)
    assert body.warnings == ()
    assert body.solids == ()
    assert len(body.mesh.triangles) == len(ring.faces)
    assert len(body.parts) == len(body.mesh.cover.parts) > 2
    assert body.mesh.cover.excess < 0.01
    radius = np.linalg.norm(body.volume_points[:, :2], axis=1)
    assert radius.min() > 0.027
    np.testing.assert_allclose(body.center_of_mass, 0.0, atol=1e-9)


def test_a_bin_of_touching_boxes_is_hollow_also_where_they_share_their_corners():
    walls = [((0.0, 0.0, -0.05), (0.2, 0.2, 0.01))]
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        size = (0.01 if x else 0.2, 0.01 if y else 0.2, 0.1)
        walls.append(((0.1 * x, 0.1 * y, 0.0), size))
    bin_ = trimesh.util.concatenate(
        [box(*size).apply_translation(centre) for centre, size in walls]
    )
    whole = body_of(bin_)
    assert len(whole.solids) == 5
    soup = np.asarray(bin_.triangles).reshape(-1, 3)
    for body in (whole, Body.from_mesh(soup, np.arange(len(soup)).reshape(-1, 3))):
        inside = (np.abs(body.volume_points) < [0.09, 0.09, 0.04]).all(axis=1)
        assert not inside.any()
        assert not any((part.normals @ np.zeros(3) <= part.offsets).all() for part in body.parts)


def test_a_sheet_among_the_pieces_weighs_nothing():
    sheet = trimesh.Trimesh([[0.1, 0, 0], [0.2, 0, 0], [0.1, 0.1, 0]], [[0, 1, 2]])
    body = body_of(trimesh.util.concatenate([box(0.1, 0.1, 0.1), sheet]))
    assert any("not closed" in warning for warning in body.warnings)
    assert len(body.solids) == 1
    assert not body.mesh.cover.closed
    np.testing.assert_allclose(body.center_of_mass, 0.0, atol=1e-12)


def test_scale_applies_to_mesh_and_center_of_mass():
    body = body_of(box(144, 124, 36), scale=0.001, center_of_mass=(0.0, 0.0, 5.0))
    assert np.ptp(body.vertices, axis=0) == pytest.approx([0.144, 0.124, 0.036])
    np.testing.assert_allclose(body.center_of_mass, [0.0, 0.0, 0.005])


GOOD = box(0.1, 0.1, 0.1)


@pytest.mark.parametrize(
    ("vertices", "triangles", "options", "message"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), int), {}, "empty"),
        (GOOD.vertices, np.zeros((0, 3), int), {}, "empty"),
        (GOOD.vertices[:, :2], GOOD.faces, {}, "shape"),
        (GOOD.vertices, GOOD.faces[:, :2], {}, "shape"),
        (GOOD.vertices, GOOD.faces + 1, {}, "index"),
        (GOOD.vertices, GOOD.faces - 1, {}, "index"),
        (GOOD.vertices, GOOD.faces.astype(float), {}, "integers"),
        (GOOD.vertices * np.nan, GOOD.faces, {}, "finite"),
        (GOOD.vertices * 1000.0, GOOD.faces, {}, "100 m across.*needs `scale` 0.001"),
        (GOOD.vertices * 1e-3, GOOD.faces, {"scale": 1e-3}, "too small, less than 0.001 m; look"),
        (GOOD.vertices * 1e39, GOOD.faces, {}, "1e.38 m across.*larger than 2.0 m; look at its"),
        (GOOD.vertices * 2e309, GOOD.faces, {}, "finite"),
        (GOOD.vertices * 1e308 * 30.0, GOOD.faces, {}, "inf m across.*look at its numbers"),
        (GOOD.vertices * [1, 1, 0], GOOD.faces, {}, "flat mesh.*thickness"),
        (GOOD.vertices * [1, 0, 0], GOOD.faces, {}, "flat mesh.*thickness"),
        (GOOD.vertices, GOOD.faces, {"scale": 0.0}, "scale"),
        (GOOD.vertices, GOOD.faces, {"center_of_mass": (0.0, 0.0, 0.2)}, "outside"),
        (GOOD.vertices, GOOD.faces, {"center_of_mass": (0.0, 0.0)}, "three"),
        (GOOD.vertices, GOOD.faces, {"center_of_mass": (0.0, 0.0, np.nan)}, "finite"),
    ],
)
def test_bad_meshes_are_refused(vertices, triangles, options, message):
    with pytest.raises(ObjectError, match=message) as refused:
        Body.from_mesh(vertices, triangles, **options)
    assert refused.value.code == "BAD_OBJECT"


def test_triangles_that_disagree_are_turned():
    mesh = box(0.1, 0.06, 0.04)
    for turned in ([0, 1, 2, 3, 4, 5], [0], [0, 5, 7]):
        faces = np.array(mesh.faces)
        faces[turned] = faces[turned][:, ::-1]
        body = Body.from_mesh(mesh.vertices, faces)
        np.testing.assert_allclose(body.center_of_mass, 0.0, atol=1e-9)
        assert len(body.faces) == 6
    assert body_of(mesh).warnings == ()


def test_what_is_too_much_is_refused_with_its_number():
    with pytest.raises(ObjectError, match=r"900003 of them.*900000"):
        Body.from_mesh(np.zeros((900_003, 3)), [[0, 1, 2]])
    with pytest.raises(ObjectError, match=r"400000 of them.*300000"):
        Body.from_mesh(np.eye(3) * 0.1, [[0, 1, 2]] * 400_000)
    some = [box(0.001, 0.001, 0.001).apply_translation([0.002 * n, 0, 0]) for n in range(501)]
    with pytest.raises(ObjectError, match=r"501 pieces.*500"):
        body_of(trimesh.util.concatenate(some))


@pytest.mark.parametrize("odd", [np.nan, np.inf, 1e300])
def test_vertices_of_no_triangle_are_no_part_of_the_object(odd):
    mesh = box(0.1, 0.2, 0.3)
    vertices = np.vstack([[odd, 0.0, 0.0], mesh.vertices, [0.0, odd, 9.0]])
    body = Body.from_mesh(vertices, mesh.faces + 1)
    np.testing.assert_array_equal(body.vertices, mesh.vertices)
    np.testing.assert_allclose(body.center_of_mass, 0.0, atol=1e-12)


@pytest.mark.parametrize("away", [1e15, 1e300])
def test_a_mesh_that_rounding_flattens_is_refused(away):
    mesh = box(0.1, 0.2, 0.3)
    with pytest.raises(ObjectError):
        Body.from_mesh(np.add(mesh.vertices, [away, 0.0, 0.0]), mesh.faces)
    assert Body.from_mesh(np.add(mesh.vertices, [99.0, 0.0, 0.0]), mesh.faces).faces
