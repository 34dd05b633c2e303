"""The landscape of heights: its passes against the geometry of boxes and prisms."""

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core.body.tipping import Tipping


def of(mesh, center=(0.0, 0.0, 0.0)):
    return Tipping.of(np.asarray(mesh.vertices), np.array(center))


def facet_towards(tipping, direction):
    return int(np.argmax(tipping.normals @ np.array(direction)))


def test_a_box_tips_over_its_nearer_edge():
    tipping = of(trimesh.creation.box((0.04, 0.06, 0.10)))
    bottom = facet_towards(tipping, (0, 0, -1))
    assert tipping.heights[bottom] == pytest.approx(0.05)
    assert tipping.way_out(bottom, 0.3) == pytest.approx(np.hypot(0.05, 0.02))
    side = facet_towards(tipping, (1, 0, 0))
    assert tipping.way_out(side, 0.3) == pytest.approx(np.hypot(0.02, 0.03))
    assert len(tipping.valleys(0.0)) >= 6
    assert len(tipping.valleys(1e-6)) == 6


def test_the_shallower_of_two_valleys_ends_where_they_meet():
    rise = np.hypot(0.05, 0.02) - 0.05  # out of the two ends of the box
    tipping = of(trimesh.creation.box((0.04, 0.06, 0.10)))
    assert len(tipping.valleys(rise - 1e-9)) == 6
    assert len(tipping.valleys(rise + 1e-9)) == 4


def test_a_valley_is_found_beside_a_facet_that_cannot_be_stood_on():
    # the centre of mass is beyond the bottom's edge: turning on goes downhill to the side
    tipping = of(trimesh.creation.box((0.1, 0.1, 0.1)), (0.049, 0.0, 0.0))
    found = tipping.normals[tipping.valleys(0.001)]
    np.testing.assert_allclose(np.unique(found.round(6), axis=0), [[-1, 0, 0], [1, 0, 0]])


@pytest.mark.parametrize("sides", [12, 32])
def test_a_prism_gets_all_around_at_the_height_of_its_edges(sides):
    tipping = of(trimesh.creation.cylinder(radius=0.03, height=0.1, sections=sides))
    side = facet_towards(tipping, (1, 0, 0))
    inner = 0.03 * np.cos(np.pi / sides)
    assert tipping.heights[side] == pytest.approx(inner)
    assert tipping.way_out(side, 0.6) == pytest.approx(0.03)
    there = tipping.around(side, inner - 1e-6, 0.03 + 1e-6)
    assert (np.abs(tipping.normals[there][:, 2]) < 1e-9).all()
    assert there.sum() == 2 * sides
    below = tipping.around(side, inner - 1e-6, 0.03 - 1e-6)
    assert below.sum() == 2  # its own triangles


def test_no_way_between_facets_is_lower_than_a_walk_over_all_directions():
    # a dense walk over the sphere of directions, with steps of less than half a degree
    rng = np.random.default_rng(3)
    points = rng.normal(size=(24, 3)) * [0.05, 0.04, 0.03]
    center = points.mean(axis=0)
    tipping = Tipping.of(points, center)
    ball = trimesh.creation.icosphere(subdivisions=6)
    height = ((points - center) @ ball.vertices.T).max(axis=0)
    bottoms = tipping.valleys(0.0005)
    assert len(bottoms) >= 2
    start, *others = bottoms[np.argsort(-tipping.heights[bottoms])].tolist()
    at, *ends = (ball.vertices @ tipping.normals[[start, *others]].T).argmax(axis=0)
    levels = np.unique(tipping.passes)
    for other, end in zip(others, ends, strict=True):
        joined = [bool(tipping.around(start, -1.0, level)[other]) for level in levels]
        over = levels[joined.index(True)]
        for level, reached in ((over - 0.0008, False), (over + 0.0008, True)):
            inside = height <= level
            edges = ball.edges_unique[inside[ball.edges_unique].all(axis=1)]
            label = trimesh.graph.connected_component_labels(edges, len(ball.vertices))
            assert (label[at] == label[end]) == reached
