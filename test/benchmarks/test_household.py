"""The household's things: closed, of the parts that physics takes, and held as a hand can."""

import numpy as np
import pytest
import trimesh
from helpers.problems import problem_of
from scipy.spatial import ConvexHull

from benchmarks.cases import Case
from benchmarks.household import HOUSEHOLD, SINGLE_MESHES, object_by_name
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.grasp.feasible_grasps import usable_holdings
from placement_planner_ros.core.grasp.settings import GraspSettings


def surface(thing):
    return trimesh.Trimesh(thing.vertices, thing.triangles, process=False)


@pytest.mark.parametrize("name", HOUSEHOLD)
def test_each_piece_is_a_solid_that_faces_outward(name):
    pieces = surface(object_by_name(name)).split(only_watertight=False)
    assert len(pieces) == {"mug": 2, "drill": 4}.get(name, 1)
    assert all(piece.is_volume for piece in pieces)


@pytest.mark.parametrize("name", HOUSEHOLD)
def test_it_rests_on_something_and_every_grasp_can_be_used(name):
    problem, _ = problem_of(Case("table", name, "maximize_clearance"))
    holdings, why_not = usable_holdings(problem, GraspSettings())
    assert why_not == ()
    assert [len(of_arm) for of_arm in holdings] == [len(arm.grasps) for arm in problem.arms]
    assert len(problem.body.faces) >= 2


def test_what_is_hollow_is_hollow():
    """A point in the middle of the opening is in no solid, and B_o has none near it."""
    for name in ("mug", "bowl", "tray", "bin"):
        thing = object_by_name(name)
        body = Body.from_mesh(thing.vertices, thing.triangles, thing.center_of_mass)
        assert body.mesh is not None
        assert max(part.depth(np.array([[0.0, 0.0, 0.02]]))[0] for part in thing.parts) < 0
        near = np.linalg.norm(body.volume_points - [0.0, 0.0, 0.02], axis=1)
        assert near.min() > 0.01


@pytest.mark.parametrize("name", SINGLE_MESHES)
def test_single_meshes_are_the_closed_surface_of_the_same_solids(name: str) -> None:
    surface, solids = object_by_name(name), object_by_name(name.removesuffix("_mesh"))
    made = trimesh.Trimesh(surface.vertices, surface.triangles, process=False)
    assert made.is_volume
    assert made.body_count == 1
    np.testing.assert_allclose(made.bounds[0], solids.vertices.min(axis=0), atol=1e-12)
    np.testing.assert_allclose(made.bounds[1], solids.vertices.max(axis=0), atol=1e-12)
    # the solids only touch each other
    assert made.volume == pytest.approx(sum(ConvexHull(p.vertices).volume for p in solids.parts))
    centres = made.triangles_center - 1e-6 * made.face_normals
    depth = np.max([part.depth(centres) for part in solids.parts], axis=0)
    assert depth.min() > 0
    assert np.max([part.depth(centres + 2e-6 * made.face_normals) for part in solids.parts]) < 0
    assert surface.grasps == solids.grasps
