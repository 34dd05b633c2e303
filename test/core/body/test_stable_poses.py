"""What a body rests on, and from where it could roll: shapes, with the noise of a scan too."""

import numpy as np
import pytest
import trimesh
from helpers.scans import SHAPES, finer, noisy

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.body.stable_poses import TIPPING_RISE_M, stable_poses
from placement_planner_ros.core.body.tipping import Tipping

FIRM = {
    "box": 6,
    "bulging box": 6,
    "cylinder of 12": 2,
    "cylinder of 32": 2,
    "cone": 1,
    "ball": 0,
    "bottle": 2,
    "hollow bowl": 2,
    "mug": 4,
    "banana": 2,
    "drill": 5,
}


def found(mesh, flatness=0.0015):
    tipping = Tipping.of(np.asarray(mesh.vertices), np.asarray(mesh.center_mass))
    return tipping, stable_poses(tipping, flatness, 0.18)


@pytest.mark.parametrize("name", FIRM)
def test_shapes_rest_on_the_sides_a_person_would_name(name):
    _, made = found(SHAPES[name]())
    assert sum(not rolls for rolls in made.values()) == FIRM[name]
    assert any(made.values()) == (name.startswith(("cylinder", "cone", "ball", "bottle")))


def test_a_prism_of_few_sides_does_not_roll():
    for sides, rolls in ((6, False), (8, False), (11, False), (12, True), (13, True)):
        _, made = found(trimesh.creation.cylinder(radius=0.1, height=0.1, sections=sides))
        assert any(made.values()) == rolls
        firm = sum(not could_roll for could_roll in made.values())
        assert firm == (2 if rolls else 2 + sides)


def test_what_topples_over_round_edges_does_not_roll():
    """It keeps its height while it turns by 78 degrees, but stays nowhere on the way."""
    size, radius = np.array([0.07, 0.164, 0.213]), 0.015
    corners = trimesh.creation.box(size - 2.0 * radius).vertices
    ball = trimesh.creation.icosphere(subdivisions=3, radius=radius).vertices
    points = (corners[:, None] + ball).reshape(-1, 3)
    _, made = found(trimesh.convex.convex_hull(points))
    assert len(made) == 6
    assert not any(made.values())


def test_a_side_with_a_flat_ridge_is_stood_on_and_one_with_a_steep_ridge_rocks():
    for degrees, firm in ((4.8, True), (5.6, False)):
        x, y, z = 0.03, 0.025, 0.095
        ridge = [[0.0, -y - x * np.tan(np.radians(degrees)), side] for side in (-z, z)]
        box = trimesh.creation.box((2.0 * x, 2.0 * y, 2.0 * z)).vertices
        tipping, made = found(trimesh.convex.convex_hull(np.concatenate([box, ridge])))
        beneath = [facet for facet in made if tipping.normals[facet] @ [0.0, -1.0, 0.0] > 0.9]
        assert beneath
        assert any(not made[facet] for facet in beneath) == firm


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", ["large_crayons_box", "box", "tall box"])
def test_a_box_keeps_its_six_sides_under_noise_of_a_millimetre(name, seed):
    mesh = noisy(finer(SHAPES[name](), 6000), 0.001, np.random.default_rng(seed))
    tipping, made = found(mesh)
    normals = tipping.normals[[*made]]
    assert len(made) == 6
    assert not any(made.values())
    assert (np.abs(normals).max(axis=1) > np.cos(0.1)).all()


@pytest.mark.parametrize("name", ["cylinder of 12", "cylinder of 32", "cone", "ball", "bottle"])
def test_noise_does_not_keep_what_is_round_from_rolling(name):
    mesh = noisy(finer(SHAPES[name](), 6000), 0.001, np.random.default_rng(5))
    tipping, made = found(mesh)
    firm = [facet for facet, rolls in made.items() if not rolls]
    assert (np.abs(tipping.normals[firm][:, 2]) > np.cos(0.2)).all()
    assert any(made.values())


def test_what_could_roll_is_offered_only_when_allowed():
    mesh = SHAPES["cylinder of 32"]()
    body = Body.from_mesh(mesh.vertices, mesh.faces)
    assert not any(face.rolls for face in body.faces)
    assert len(body.faces) == 2
    assert 3 < body.rolling < 8  # they lie 0.8 rad apart, or more
    allowed = Body.from_mesh(mesh.vertices, mesh.faces, settings=BodySettings(allow_rolling=True))
    assert (sum(face.rolls for face in allowed.faces), allowed.rolling) == (body.rolling, 0)
    ball = SHAPES["ball"]()
    assert Body.from_mesh(ball.vertices, ball.faces).faces == ()
    allowed = Body.from_mesh(ball.vertices, ball.faces, settings=BodySettings(allow_rolling=True))
    assert len(allowed.faces) > 5


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_where_little_touches_v_of_f_reaches_as_far_as_the_body_may_rock(seed):
    mesh = noisy(finer(SHAPES["flat box"](), 6000), 0.001, np.random.default_rng(seed))
    body = Body.from_mesh(mesh.vertices, mesh.faces, settings=BodySettings(flatness=0.0002))
    for face in body.faces:
        at = face.T_face_object.act(body.center_of_mass)
        outline = (face.vertices @ face.T_face_object.rotation.T)[:, :2]
        outline = outline + face.T_face_object.translation[:2]
        edges = np.roll(outline, -1, axis=0) - outline
        across = edges[:, 0] * (at[1] - outline[:, 1]) - edges[:, 1] * (at[0] - outline[:, 0])
        distance = np.abs(across / np.linalg.norm(edges, axis=1)).min()
        assert (across > 0).all() or (across < 0).all()
        rise = np.hypot(at[2], distance) - at[2]
        assert rise > 0.5 * TIPPING_RISE_M
