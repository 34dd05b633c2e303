"""The household's things: closed, of the parts that physics takes, and held as a hand can."""

import numpy as np
import pytest
import trimesh
from helpers.problems import problem_of
from scipy.spatial import ConvexHull

from benchmarks.cases import GROUPS, Case, all_cases
from benchmarks.household import HOUSEHOLD, OBJECT_NAMES, SINGLE_MESHES, object_by_name
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
def test_parts_are_what_the_surface_encloses(name):
    """To 0.2 or 0.3 mm; the rings of bent tubes are not quite planar between each other."""
    thing = object_by_name(name)
    points, triangles = trimesh.sample.sample_surface(surface(thing), 3000, seed=0)
    normals = surface(thing).face_normals[triangles]
    below, above = (
        np.max([part.depth(points + side * 2e-4 * normals) for part in thing.parts], axis=0)
        for side in (-1, 1)
    )
    assert below.min() > -1e-4
    if name not in ("mug", "drill"):  # whose parts reach into each other
        assert above.max() < 0


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


def test_groups_keep_the_papers_cases_apart():
    assert GROUPS["paper"] == OBJECT_NAMES
    assert len(all_cases()) == 24
    assert len(all_cases(objects=GROUPS["household"])) == 36
    names = [name for group in GROUPS.values() for name in group]
    assert len(names) == len(set(names))


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
