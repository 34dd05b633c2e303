"""The bundled scenes are the paper's, stand on what is below them and overlap nowhere."""

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import linprog

from placement_planner_ros.scenes.primitives import ConvexPrimitive
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


def thing_of(part: ConvexPrimitive) -> str:
    """What a piece belongs to: a bowl's pieces are one thing."""
    return part.name.split("/")[0]


def volume_of(part: ConvexPrimitive) -> float:
    a, b, c = (part.vertices[part.triangles[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


@pytest.fixture(params=BUNDLED_SCENES)
def scene(request: pytest.FixtureRequest) -> Scene:
    return scene_by_name(request.param)


def test_clutter_stands_on_furniture(scene: Scene) -> None:
    for name in {thing_of(part) for part in scene.parts} - FURNITURE:
        vertices = np.vstack([part.vertices for part in scene.parts if thing_of(part) == name])
        feet = vertices[vertices[:, 2] < vertices[:, 2].min() + 1e-9]
        below = feet - [0, 0, 1e-6]
        assert any(
            (part.depth(below) > 0).all() for part in scene.parts if thing_of(part) in FURNITURE
        ), name


def test_things_do_not_overlap(scene: Scene) -> None:
    for a, b in combinations(scene.parts, 2):
        if {thing_of(a), thing_of(b)} <= FURNITURE:
            continue  # the cabinet's boards run into each other, as measured
        low = np.maximum(a.vertices.min(axis=0), b.vertices.min(axis=0))
        high = np.minimum(a.vertices.max(axis=0), b.vertices.max(axis=0))
        if (high > low).all():
            assert overlap(a, b) < 1e-7, (a.name, b.name)


def test_solids_are_closed_and_face_outwards(scene: Scene) -> None:
    for part in scene.parts:
        assert volume_of(part) > 0
        np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1)
        assert part.depth(part.vertices).max() == pytest.approx(0, abs=1e-9)
        assert part.depth(part.vertices.mean(axis=0)[None])[0] > 0
