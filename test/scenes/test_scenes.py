"""The bundled scenes are the paper's, stand on what is below them and overlap nowhere."""

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import linprog

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.scenes.primitives import ConvexPrimitive, bowl, frustum, standing_box
from placement_planner_ros.scenes.scenes import BUNDLED_SCENES, Scene, scene_by_name

FURNITURE = {"drawers", "left_wall", "right_wall", "back", "top", "divider", "table"} | {
    "lower_shelf",
    "upper_shelf",
    "board",
    "left_side",
    "right_side",
}


def overlap(a: ConvexPrimitive, b: ConvexPrimitive) -> float:
    """Radius of the largest ball inside both solids, metres; ≤ 0 where they only touch."""
    A = np.vstack([a.normals, b.normals])
    d = np.concatenate([a.offsets, b.offsets])
    result = linprog(
        [0, 0, 0, -1], np.column_stack([A, np.ones(len(A))]), d, bounds=[(None, None)] * 4
    )
    return -float(result.fun)


def volume_of(part: ConvexPrimitive) -> float:
    a, b, c = (part.vertices[part.triangles[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


@pytest.fixture(params=BUNDLED_SCENES)
def scene(request: pytest.FixtureRequest) -> Scene:
    return scene_by_name(request.param)


def test_names_are_refused_with_those_there_are() -> None:
    with pytest.raises(ParameterError, match="cabinet_low_clutter, cabinet_high_clutter, table"):
        scene_by_name("cupboard")


def test_clutter_stands_on_furniture(scene: Scene) -> None:
    for name in set(scene.things) - FURNITURE:
        vertices = np.vstack([part.vertices for part in scene.parts if part.thing == name])
        feet = vertices[vertices[:, 2] < vertices[:, 2].min() + 1e-9]
        below = feet - [0, 0, 1e-6]
        assert any(
            (part.depth(below) > 0).all() for part in scene.parts if part.thing in FURNITURE
        ), name


def test_things_do_not_overlap(scene: Scene) -> None:
    for a, b in combinations(scene.parts, 2):
        if {a.thing, b.thing} <= FURNITURE:
            continue  # the cabinet's boards run into each other, as measured
        low = np.maximum(a.vertices.min(axis=0), b.vertices.min(axis=0))
        high = np.minimum(a.vertices.max(axis=0), b.vertices.max(axis=0))
        if (high > low).all():
            assert overlap(a, b) < 1e-7, (a.name, b.name)


def test_part_names_are_unique(scene: Scene) -> None:
    names = [part.name for part in scene.parts]
    assert len(set(names)) == len(names)


def test_overlap_is_seen() -> None:
    a = standing_box("a", (1, 1, 1), (0, 0), 0, 0, (1, 0, 0))
    b = standing_box("b", (1, 1, 1), (0.9, 0), 0, 0, (1, 0, 0))
    assert overlap(a, b) == pytest.approx(0.05)


def test_solids_are_closed_and_face_outwards(scene: Scene) -> None:
    for part in scene.parts:
        assert volume_of(part) > 0
        np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1)
        assert part.depth(part.vertices).max() == pytest.approx(0, abs=1e-9)
        assert part.depth(part.vertices.mean(axis=0)[None])[0] > 0


def test_primitives_have_their_measures() -> None:
    turned = standing_box("box", (0.2, 0.04, 0.03), (1, 2), np.deg2rad(30), 0.5, (1, 0, 0))
    assert volume_of(turned) == pytest.approx(0.2 * 0.04 * 0.03)
    assert len(turned.normals) == 6
    end = np.array([1, 2, 0.51]) + 0.0999 * np.array([np.cos(np.pi / 6), 0.5, 0])
    assert turned.depth(end[None])[0] == pytest.approx(1e-4)
    can = frustum("can", (0.05, 0.05), (0, 0.1), (1, 0, 0))
    area = 24 * 0.05**2 * np.sin(2 * np.pi / 48)
    assert volume_of(can) == pytest.approx(area * 0.1)
    assert len(can.normals) == 50


def test_faces_are_polygons_in_order() -> None:
    can = frustum("can", (0.05, 0.03), (0, 0.1), (1, 0, 0))
    for face, normal in enumerate(can.normals):
        corners = can.polygon(face)
        assert len(corners) in (4, 48)
        following, after = np.roll(corners, -1, axis=0), np.roll(corners, -2, axis=0)
        assert (np.cross(following - corners, after - following) @ normal > 0).all()


def test_a_bowl_is_open_above_and_closed_around() -> None:
    parts = bowl("bowl", (0.16, 0.055), (0, 0, 0), (1, 1, 1))

    def depth(point: tuple[float, float, float]) -> float:
        return max(float(part.depth(np.array([point]))[0]) for part in parts)

    assert depth((0, 0, 0.002)) > 0
    assert depth((0, 0, 0.0045)) < 0
    assert depth((0.07, 0, 0.05)) < 0
    rng = np.random.default_rng(0)
    for angle in rng.uniform(-np.pi, np.pi, 200):
        along = np.linspace(0, 0.1, 400)
        ray = np.column_stack([along * np.cos(angle), along * np.sin(angle), np.full(400, 0.05)])
        assert max(float(part.depth(ray).max()) for part in parts) > 0
