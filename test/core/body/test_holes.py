"""Holes of scans: what they do to the centre of mass, and how far it is to be trusted."""

import re

import numpy as np
import trimesh
from helpers.scans import SHAPES, finer

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.convex_cover import hull_cover


def nearly_closed(mesh, share):
    """Without that share of its triangles, and what it is taken for with and without them."""
    kept = np.random.default_rng(2).random(len(mesh.faces)) >= share
    bodies = [
        Body.from_mesh(mesh.vertices, faces, cover=lambda v, t, _: hull_cover(v, t))
        for faces in (mesh.faces, mesh.faces[kept])
    ]
    return *bodies, float(np.linalg.norm(bodies[0].center_of_mass - bodies[1].center_of_mass))


def test_small_holes_hardly_move_the_centre_of_mass_and_are_said():
    """A bowl: the centre of its hull is 10 mm higher than its own."""
    whole, holed, off = nearly_closed(finer(SHAPES["hollow bowl"](), 5000), 0.02)
    assert off < 3e-4
    assert len(holed.faces) == len(whole.faces)
    (said,) = [words for words in holed.assumed if words.startswith("centre of mass")]
    bound = float(re.search(r"holes closed: at most (\S+) m off", said).group(1))
    assert off <= bound < 0.004
    assert holed.mesh is not None
    assert not holed.mesh.cover.closed
    assert "sheet" in holed.warnings[0]


def test_where_holes_may_move_it_far_the_centre_of_mass_is_that_of_the_hull():
    _, holed, off = nearly_closed(finer(SHAPES["banana"](), 5000), 0.15)
    assert off > 0.003
    assert "of its hull" in holed.assumed[1]
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    half = ball.faces[ball.triangles_center[:, 2] > 0.0]
    body = Body.from_mesh(ball.vertices, half, cover=lambda v, t, _: hull_cover(v, t))
    assert "of its hull" in body.assumed[1]
