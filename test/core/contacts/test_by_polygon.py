"""Support by polygon against plain geometry, on random racks, bridges, pedestals and posts."""

import functools
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from helpers.footholds import (
    Block,
    bare_problem,
    carried_corners,
    pedestal,
    problem_on,
    rack,
    spare,
)
from helpers.pose_sets import placement_pose

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.contact_points import contact_points
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.contacts.by_polygon import TIPS
from placement_planner_ros.core.contacts.friction_cones import DIRECTIONS, TILT_RAD, stays
from placement_planner_ros.core.planner import PlannerSettings

POLYGON = PlannerSettings(support="polygon")
SCENES = {
    "bridge": [Block("bridge", (0.2, 0.8), (-0.025, 0.025))],
    "rack": rack(0.045, 0.095),
    "pedestal": [pedestal(0.06)],
    "posts": [
        pedestal(0.02, 0.45, 0.0, name="a"),
        pedestal(0.02, 0.55, 0.01, name="b"),
        pedestal(0.02, 0.49, 0.08, name="c"),
    ],
    "corner": [
        Block("long", (0.44, 0.48), (-0.08, 0.08), depth=0.2),
        Block("short", (0.48, 0.56), (-0.08, -0.04), depth=0.2),
    ],
}


def box(sides, center=None):
    mesh = trimesh.creation.box(sides)
    return Body.from_mesh(mesh.vertices, mesh.faces, center)


def legged():
    """A slab on four feet of 14 mm."""
    parts = [trimesh.creation.box((0.16, 0.11, 0.02))]
    for x in (-0.07, 0.07):
        for y in (-0.045, 0.045):
            parts.append(
                trimesh.creation.box((0.014, 0.014, 0.06)).apply_translation((x, y, -0.04))
            )
    mesh = trimesh.util.concatenate(parts)
    return Body.from_mesh(mesh.vertices, mesh.faces)


BODIES = {
    "box": box((0.17, 0.12, 0.05)),
    "off centre": box((0.17, 0.12, 0.05), (0.05, -0.02, 0.0)),
    "tall": box((0.06, 0.06, 0.25)),
    "legged": legged(),
}


def patches_of(body, face, T):
    """Convex polygons of what touches on one of the faces."""
    if body is not BODIES["legged"]:
        return [(face.vertices @ T.rotation.T + T.translation)[:, :2]]
    down = face.normal
    found = []
    for part in body.solids:
        depth = (face.vertices[0] - part.vertices) @ down
        if depth.min() < 1e-6:
            touching = part.vertices[depth < 1e-6]
            corners = (touching @ T.rotation.T + T.translation)[:, :2]
            middle = corners.mean(axis=0)
            order = np.argsort(np.arctan2(*(corners - middle).T))[::-1]
            found.append(corners[order])
    return found


@functools.cache
def environment_of(scene):
    return problem_on(BODIES["box"], SCENES[scene]).environment


def on_scene(scene, body):
    return replace(bare_problem(body), environment=environment_of(scene))


def draw(poses, rng, count):
    """Faces, contacts and angles on the regions that a rule offers."""
    regions = poses.contacts.regions
    picked = rng.integers(len(regions), size=count)
    contacts = np.array([regions[k].sample(rng) for k in picked])
    slopes = np.array([regions[k].slope for k in picked])
    faces = rng.integers(len(poses.problem.body.faces), size=count)
    return faces, contacts, rng.uniform(0.0, 2.0 * np.pi, count), slopes


def trimmed(blocks, off):
    """The blocks, narrower by so much on every side."""
    return [
        replace(b, x=(b.x[0] + off, b.x[1] - off), y=(b.y[0] + off, b.y[1] - off)) for b in blocks
    ]


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("scene", SCENES)
def test_what_stands_is_what_plain_geometry_says(scene, name):
    """Never where it does not; and where it does by more than points are apart, always."""
    margin = 0.01
    body, blocks = BODIES[name], SCENES[scene]
    problem = on_scene(scene, body)
    settings = replace(POLYGON, support_margin=margin)
    poses = PoseConstraints(problem, settings.collision, settings.footing, 0.0)
    if not poses.contacts.regions:  # too little for any margin
        poses = PoseConstraints(problem, settings.collision, POLYGON.footing, 0.0)
    # the support map closes corners that are cut into a surface a little
    bay = 0.005 if scene == "corner" else 1e-6
    rng = np.random.default_rng(3)
    stood = 0
    for face, contact, angle, _ in zip(*draw(poses, rng, 150), strict=True):
        if abs(contact[2]) > 1e-6:
            continue
        T = placement_pose(poses.problem.body.faces[face], contact, angle)
        resting = body.faces[face]
        center = T.act(body.center_of_mass)
        patches = patches_of(body, resting, T)
        inside, tips = spare(patches, blocks, center[:2], center[2])
        stands = poses.stable(T, int(face))
        stood += stands
        if stands:
            assert inside > margin - bay
            assert np.tan(tips) * center[2] > np.tan(TIPS) * center[2] - bay
        else:
            # nor would it on what is left of each block away from its edges
            core, _ = spare(patches, trimmed(blocks, 0.009), center[:2], center[2])
            assert core < 0.006 + max(margin, center[2] * np.tan(TIPS))
    assert stood or margin > 0.0 or name == "legged"


@pytest.mark.parametrize("scene", ["bridge", "posts", "corner"])
def test_friction_cones_under_a_face_bear_what_its_polygon_says(scene):
    """A force aside moves the foot along gravity: it is borne where that stays in the hull."""
    body, blocks = BODIES["off centre"], SCENES[scene]
    poses = PoseConstraints(on_scene(scene, body), POLYGON.collision, POLYGON.footing, 0.0)
    around = 1.001 / np.cos(np.pi / DIRECTIONS)  # directions are the corners of a polygon
    said = set()
    for face, contact, angle, _ in zip(*draw(poses, np.random.default_rng(4), 60), strict=True):
        assert abs(contact[2]) < 1e-6
        T = placement_pose(poses.problem.body.faces[face], contact, angle)
        center = T.act(body.center_of_mass)
        patches = patches_of(body, body.faces[face], T)
        floor = carried_corners(patches, blocks)
        if not len(floor):
            continue
        inside, _ = spare(patches, blocks, center[:2], center[2])
        on = np.column_stack([floor, np.zeros(len(floor))]), np.zeros((0, 3)), 0.0, center, 0.6
        for aside in (0.08, 0.2, 0.4):
            bears = stays(*on, aside - np.tan(TILT_RAD))
            if not 1.0 < inside / (aside * center[2]) < around:
                assert bears == (inside > aside * center[2])
                said.add(bears)
        if scene != "corner" and poses.stable(T, int(face)):
            assert stays(*on, np.tan(TIPS) / around - np.tan(TILT_RAD))
    assert said == {True, False}


def test_what_rises_from_a_foot_does_not_touch():
    """A block that is wider above, and slants down to its foot."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    vertices = np.vstack(
        [np.c_[0.04 * corners, np.zeros(4)], np.c_[0.07 * corners, np.full(4, 0.04)]]
    )
    mesh = trimesh.Trimesh(vertices).convex_hull
    body = Body.from_mesh(mesh.vertices, mesh.faces)
    face = next(face for face in body.faces if face.normal[2] < -0.99)
    points = contact_points(body, face).points
    slant = body.flatness * 0.03 / 0.04
    widths = np.ptp(points, axis=0)
    assert (widths >= 0.08 - 1e-9).all()
    assert (widths <= 0.08 + 2.0 * slant + 1e-9).all()


@pytest.mark.parametrize(("low", "stands"), [(0.0, True), (0.0025, False)])
def test_bars_that_are_lower_than_others_carry_nothing(low, stands):
    """A box across three bars, of which the middle one is higher, rocks on it."""
    blocks = [
        Block(f"bar {k}", (x, x + 0.03), (-0.2, 0.2), -low if k != 1 else 0.0)
        for k, x in enumerate((0.40, 0.485, 0.57))
    ]
    body = box((0.2, 0.1, 0.06), (0.06, 0.0, 0.0))
    problem = problem_on(body, blocks)
    poses = PoseConstraints(problem, POLYGON.collision, POLYGON.footing, 0.0)
    face = next(k for k, f in enumerate(body.faces) if f.normal[2] < -0.99)
    resting = poses.problem.body.faces[face]
    found = []
    for angle in np.arange(0.0, 2.0 * np.pi, 0.1):
        T = placement_pose(resting, np.array([0.545, 0.0, 0.0]), angle)
        x = (body.faces[face].vertices @ T.rotation.T + T.translation)[:, 0]
        if x.min() < 0.42 and x.max() > 0.59:
            found.append(poses.stable(T, face))
    assert len(found) > 3
    assert set(found) == {stands}


@pytest.mark.parametrize(("rise", "beside", "stands"), [
    (0.0003, 0.0, True), (0.0025, 0.0, False), (0.0025, 0.07, True),
])  # fmt: skip
def test_nothing_stands_on_a_rib_that_no_contact_point_meets(rise, beside, stands):
    """Contact points are 5 mm apart, the rib is thinner, wherever it lies between them."""
    body = box((0.12, 0.08, 0.05))
    face = next(k for k, f in enumerate(body.faces) if f.normal[2] < -0.99)
    blocks = [
        pedestal(0.3, depth=0.02),
        Block("rib", (0.499, 0.501), (-0.15, 0.15), rise, depth=rise),
    ]
    problem = problem_on(body, blocks, spacing=0.002)
    poses = PoseConstraints(problem, POLYGON.collision, POLYGON.footing, 0.0)
    for off in np.arange(0.0, 0.005, 0.0005):
        contact = np.array([0.5 + beside + off, 0.0, 0.0])
        T = placement_pose(poses.problem.body.faces[face], contact, 0.0)
        assert poses.stable(T, face) == stands
