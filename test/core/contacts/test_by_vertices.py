"""What stands on uneven corners: neither leans nor rocks, by the planes of three corners each."""

import numpy as np
import pytest
import trimesh
from helpers.footholds import pedestal, problem_on

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.contacts.by_vertices import VertexSupport
from placement_planner_ros.core.contacts.coplanarity import MAX_LEAN_SLOPE, coplanar_support
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.types import LEVEL

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
FIRST = np.arange(0, 4 * 4001, 4)
"""Of four corners each, the first."""


def rocks(corners, gaps):
    """rad between the two ways in which a plate stands on three of the four corners (4, 2)."""
    points = np.column_stack([corners, gaps])
    ridge, others = (0, 2), (1, 3)
    if gaps[[0, 2]].sum() < gaps[[1, 3]].sum():
        ridge, others = others, ridge
    normals = []
    for other in others:
        normal = np.cross(points[ridge[1]] - points[ridge[0]], points[other] - points[ridge[0]])
        normals.append(normal * np.sign(normal[2]) / np.linalg.norm(normal))
    return np.arccos(np.clip(normals[0] @ normals[1], -1.0, 1.0))


@pytest.mark.parametrize("size", [(0.09, 0.09), (0.144, 0.036), (0.03, 0.05)])
def test_nothing_stands_that_could_rock_by_more_than_it_may_lean(size):
    rng = np.random.default_rng(0)
    corners = 0.5 * CORNERS * size
    gaps = rng.uniform(-0.0015, 0.0015, (4000, 4)) * rng.uniform(0.0, 1.0, (4000, 1))
    points = np.repeat(np.column_stack([corners, np.zeros(4)])[None], 4000, axis=0)
    widths, above = coplanar_support(points.reshape(-1, 3), gaps.ravel(), FIRST, 0.0)
    stands = widths > 0.0
    np.testing.assert_allclose(widths[stands], min(size))
    np.testing.assert_allclose(above[stands], gaps[stands].mean(axis=1))
    slope = np.linalg.lstsq(np.column_stack([corners, np.ones(4)]), gaps.T, rcond=None)[0][:2]
    lean, rock = np.linalg.norm(slope, axis=0), np.array([rocks(corners, each) for each in gaps])
    assert 0.05 < stands.mean() < 0.95
    assert lean[stands].max() <= MAX_LEAN_SLOPE
    assert rock[stands].max() <= MAX_LEAN_SLOPE
    assert stands[(lean <= MAX_LEAN_SLOPE) & (rock <= 0.7 * MAX_LEAN_SLOPE)].all()


def test_noise_excuses_errors_of_surfaces_but_no_step():
    noise, rng = 0.001, np.random.default_rng(0)
    points = np.column_stack([0.5 * CORNERS * (0.124, 0.036), np.zeros(4)])[None]
    errors = rng.normal(0.0, noise / 6.0, (2000, 4))
    many = np.repeat(points, 2000, axis=0).reshape(-1, 3)
    assert (coplanar_support(many, errors.ravel(), FIRST[:2001], noise)[0] > 0.0).mean() > 0.99
    steps = {"a corner 3 mm higher": [3.0, 0.0, 0.0, 0.0], "twisted": [0.75, -0.75, 0.75, -0.75]}
    for name, gaps in steps.items():
        stands = coplanar_support(points[0], 1e-3 * np.array(gaps), FIRST[:2], noise)[0][0] > 0.0
        assert not stands, name


def stands_over(thing, rise, beside=0.0):
    """Whether a thing stands whose middle is so far beside that of a square of 20 mm that rises
    from a table by so much, metres."""
    body = Body.from_mesh(thing.vertices, thing.faces)
    blocks = [pedestal(0.3, depth=0.02)]
    blocks += [pedestal(0.02, z=rise, depth=rise, name="coin")] if rise else []
    support = VertexSupport(problem_on(body, blocks), PlannerSettings().footing)
    T = np.eye(4)
    T[:3, 3] = 0.5 + beside, 0.0, -thing.vertices[:, 2].min()
    down = int(np.argmin([face.normal[2] for face in body.faces]))
    return bool(support.stable(T[None], np.array([down]), LEVEL)[0])


def test_nothing_stands_on_what_rises_between_its_corners():
    whole = trimesh.creation.box((0.09, 0.05, 0.04))
    assert stands_over(whole, 0.0)
    assert stands_over(whole, 0.0005)  # it leans by 1.1 degrees on that
    assert not stands_over(whole, 0.0015)
    assert not stands_over(whole, 0.0028)
    assert stands_over(whole, 0.0028, beside=0.062)  # more than two pixels away
    legs = [trimesh.creation.box((0.012, 0.012, 0.04)) for _ in range(4)]
    for leg, (x, y) in zip(legs, CORNERS, strict=True):
        leg.apply_translation((0.045 * x, 0.025 * y, -0.04))
    on_legs = trimesh.util.concatenate([trimesh.creation.box((0.102, 0.062, 0.04)), *legs])
    assert stands_over(on_legs, 0.0028)
