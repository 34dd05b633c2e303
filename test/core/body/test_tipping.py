"""The landscape of heights: its passes against the geometry of boxes and prisms."""

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core.body.tipping import Tipping


def of(mesh, center=(0.0, 0.0, 0.0)):
    return Tipping.of(np.asarray(mesh.vertices), np.array(center))


def facet_towards(tipping, direction):
    return int(np.argmax(tipping.normals @ np.array(direction)))


def over_edge(tipping, facet):
    """The lowest height from which on the body turns by more than 0.3 rad."""
    return min(level for level in np.unique(tipping.passes) if tipping.turns(facet, level, 0.3))


def test_a_box_tips_over_its_nearer_edge():
    tipping = of(trimesh.creation.box((0.04, 0.06, 0.10)))
    bottom = facet_towards(tipping, (0, 0, -1))
    assert tipping.heights[bottom] == pytest.approx(0.05)
    assert over_edge(tipping, bottom) == pytest.approx(np.hypot(0.05, 0.02))
    side = facet_towards(tipping, (1, 0, 0))
    assert over_edge(tipping, side) == pytest.approx(np.hypot(0.02, 0.03))
    assert len(tipping.valleys(0.0)) >= 6
    assert len(tipping.valleys(1e-6)) == 6


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
