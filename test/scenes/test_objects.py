"""The bundled objects have the paper's sizes, and the YuMi can hold and place them."""

from dataclasses import dataclass

import checker
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from placement_planner_ros.scenes.objects import BUNDLED_OBJECTS, GraspedObject, object_by_name


@dataclass(frozen=True)
class Face:
    """A facet of the object's hull that it can stand on: normal . x = offset."""

    normal: np.ndarray
    offset: float


def faces_of(thing: GraspedObject) -> list[Face]:
    """Hull facets with the projected centre of mass at least 9 mm inside."""
    planes: list[np.ndarray] = []
    for plane in ConvexHull(thing.vertices).equations:
        if not any(np.abs(plane - other).max() < 1e-6 for other in planes):
            planes.append(plane)
    faces = []
    for plane in planes:
        normal, offset = plane[:3], -plane[3]
        corners = thing.vertices[np.abs(thing.vertices @ normal - offset) < 1e-6]
        u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        axes = np.column_stack([u / np.linalg.norm(u), np.cross(normal, u / np.linalg.norm(u))])
        outline = ConvexHull(corners @ axes).equations
        if (outline[:, :2] @ (thing.center_of_mass @ axes) + outline[:, 2]).max() < -0.009:
            faces.append(Face(normal, float(offset)))
    return faces


@pytest.fixture(scope="module", params=BUNDLED_OBJECTS)
def thing(request: pytest.FixtureRequest) -> GraspedObject:
    return object_by_name(request.param)


@pytest.mark.parametrize(
    ("name", "size", "faces"),
    [
        ("large_crayons_box", (0.144, 0.124, 0.036), 6),
        ("small_crayons_box", (0.094, 0.021, 0.071), 6),
        ("wine_glass", (0.084, 0.084, 0.145), 2),
        ("toy_table", (0.110, 0.070, 0.073), 6),
    ],
)
def test_sizes_and_faces_are_the_papers(name: str, size: tuple, faces: int) -> None:
    thing = object_by_name(name)
    np.testing.assert_allclose(np.ptp(thing.vertices, axis=0), size, atol=1e-9)
    assert len(faces_of(thing)) == faces


def test_meshes_are_convex_solids_that_touch_but_do_not_overlap(thing: GraspedObject) -> None:
    pieces = checker.object_pieces(thing.vertices, thing.triangles)
    assert len(pieces) == len(thing.parts)
    assert all(piece.solid for piece in pieces)
    signed = np.linalg.det(thing.vertices[thing.triangles]).sum() / 6
    assert signed == pytest.approx(sum(ConvexHull(p.corners.reshape(-1, 3)).volume for p in pieces))
    assert thing.vertices.min(axis=0)[2] <= thing.center_of_mass[2] <= thing.vertices[:, 2].max()
    centres = np.vstack([checker.piece_voxels([piece], 0.0021) for piece in pieces])
    inside = sum(part.depth(centres) > 1e-9 for part in thing.parts)
    assert inside.max() == 1
