"""V, s(x) and c_f(x) of poses of a box near the edge of a table, against plain geometry."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from helpers.pose_sets import placement_pose
from helpers.problems import problem_of

from benchmarks.cases import Case
from placement_planner_ros.core.contacts.by_vertices import stays_standing
from placement_planner_ros.core.grasp.settings import ApproachSettings
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import LEVEL, Contact, TargetVolume, Verdict, upright

TABLE = Case("table", "small_crayons_box", "maximize_clearance")
EDGE, HEIGHT = 0.4, 0.0


@pytest.fixture(scope="module")
def problem():
    """A bare table that ends at x = EDGE, in a volume that goes on beyond."""
    bare, _ = problem_of(TABLE)
    volume = TargetVolume([0.2, -0.2, -0.05], [0.6, 0.2, 0.2])
    x, y = np.meshgrid(np.arange(0.15, EDGE + 1e-9, 0.004), np.arange(-0.3, 0.3, 0.004))
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, HEIGHT)])
    environment = Environment.from_points(
        points, volume, bounds=(volume.lower - 0.3, volume.upper + 0.3)
    )
    return replace(bare, volume=volume, environment=environment)


def constraints(problem, **settings):
    planner = PlacementPlanner(
        problem, lambda T: 0.0, replace(PlannerSettings(), **settings), np.random.default_rng(0)
    )
    return planner.sampler._checker._poses


def across_the_edge(problem, face, angle):
    """Contacts (n, 3) of poses that slide out over the edge, and how far out each reaches."""
    turned = pin.utils.rotate("z", angle) @ problem.body.faces[face].T_face_object.rotation
    corners = problem.body.faces[face].vertices @ turned.T
    ahead = float((corners[:, 0] - corners[0, 0]).max())
    furthest = EDGE + np.arange(-0.02, 0.004, 0.0002)
    contacts = np.zeros((len(furthest), 3))
    contacts[:, 0], contacts[:, 2] = furthest - ahead, HEIGHT
    return contacts, furthest


def test_contact_point_and_centre_of_mass_may_lie_in_different_boxes(problem):
    rng = np.random.default_rng(7)
    poses = constraints(problem)
    lower = np.array([[0.25, -0.1, -0.01], [0.31, -0.1, -0.01], [0.25, 0.05, 0.0]])
    upper = np.array([[0.29, 0.1, 0.03], [0.4, 0.02, 0.03], [0.4, 0.1, 0.02]])
    several = constraints(replace(problem, volume=TargetVolume(lower, upper)))
    seen = set()
    for _ in range(600):
        face = int(rng.integers(len(problem.body.faces)))
        contact = np.append(rng.uniform((0.25, -0.1), (0.4, 0.1)), HEIGHT)
        T = placement_pose(problem.body.faces[face], contact, rng.uniform(0.0, 6.3))
        center = np.append(T.act(problem.body.center_of_mass)[:2], HEIGHT)
        at = [((p >= lower) & (p <= upper)).all(axis=1) for p in (contact, center)]
        outside = not (at[0].any() and at[1].any())
        found = several.verdict(T, Contact(face, HEIGHT))
        assert (found is Verdict.OUTSIDE_VOLUME) == outside
        assert outside or found is poses.verdict(T, Contact(face, HEIGHT))
        seen.add((outside, bool((at[0] & at[1]).any())))
    assert {(True, False), (False, True), (False, False)} <= seen


@pytest.mark.parametrize("angle", [0.0, 0.6, 2.5])
def test_the_face_keeps_the_edge_margin_from_the_end_of_its_support(problem, angle):
    for face in (0, len(problem.body.faces) - 1):
        contacts, furthest = across_the_edge(problem, face, angle)
        for margin in (0.0, 0.003, 0.008):
            poses = constraints(problem, edge_margin=margin)
            stable = [
                poses.stable(placement_pose(problem.body.faces[face], c, angle), face)
                for c in contacts
            ]
            verdicts, _ = poses.verdicts(
                np.full(len(contacts), face), contacts, np.full(len(contacts), angle)
            )
            assert (verdicts > Verdict.UNSTABLE).tolist() == stable
            assert stable[0]
            assert not stable[-1]
            last = furthest[np.flatnonzero(stable)[-1]]
            # the last points may lie a spacing before the edge, the octagon is 8 % wider
            assert EDGE - 0.0045 - 1.09 * margin < last < EDGE - margin + 1e-6


def test_the_way_down_is_free_from_the_height_that_is_asked_about(problem):
    """Under a ceiling: there is less room above the box than an approach may ask for."""
    face = problem.body.faces[0]
    contact, angle = np.array([0.3, 0.0, HEIGHT]), 0.0
    pose = placement_pose(face, contact, angle)
    placed = np.vstack([part.vertices for part in problem.body.parts])
    top = (placed @ pose.rotation.T + pose.translation)[:, 2].max()
    x, y = (a.ravel() for a in np.meshgrid(*[np.arange(-0.3, 0.6, 0.004)] * 2))
    levels = [np.column_stack([x, y, np.full(len(x), z)]) for z in (HEIGHT, top + 0.05)]
    volume = problem.volume
    environment = Environment.from_points(
        np.vstack(levels), volume, bounds=(volume.lower - 0.3, volume.upper + 0.3)
    )
    changed = replace(problem, environment=environment)
    for raised in (0.01, 0.03, 0.06):
        approach = ApproachSettings(approach_minimum=raised, approach_distance=0.1)
        poses = constraints(changed, approach=approach)
        assert poses.free(pose, Contact(0, HEIGHT), 0.03)
        assert not poses.free(pose, Contact(0, HEIGHT), 0.06)
        free = raised < 0.045
        assert poses.free(pose, Contact(0, HEIGHT)) == free
        verdicts, _ = poses.verdicts(np.zeros(1, int), contact[None], np.zeros(1))
        assert verdicts[0] == (Verdict.FEASIBLE if free else Verdict.COLLIDING)


def plate(x, y, slope, height, spacing=0.004):
    """(n, 3) points of a rectangle on the plane z = height + slope · (x, y)."""
    xy = np.stack(np.meshgrid(np.arange(*x, spacing), np.arange(*y, spacing)), -1).reshape(-1, 2)
    return np.column_stack([xy, height + xy @ np.array(slope)])


def on_surfaces(problem, *plates):
    """s(x) and the rest on these, whatever slopes they have."""
    volume = TargetVolume([0.2, -0.2, -0.05], [0.6, 0.2, 0.2])
    environment = Environment.from_points(
        np.vstack(plates), volume, bounds=(volume.lower - 0.3, volume.upper + 0.3)
    )
    changed = replace(problem, volume=volume, environment=environment)
    return changed, constraints(changed, edge_margin=0.0)


@pytest.mark.parametrize(("step", "stands"), [(0.0, True), (0.0004, True), (0.0025, False)])
def test_a_step_under_an_object_is_no_support(problem, step, stands):
    """Though all of it lies within the contact tolerance."""
    _, poses = on_surfaces(
        problem,
        plate((0.1, 0.4), (-0.3, 0.3), LEVEL, 0.0),
        plate((0.4, 0.7), (-0.3, 0.3), LEVEL, -step),
    )
    across = []
    for face, resting in enumerate(problem.body.faces):
        for angle in np.arange(0.0, 2.0 * np.pi, 0.3):
            T = placement_pose(resting, np.array([0.4, 0.0, 0.0]), angle)
            middle = (resting.vertices @ T.rotation.T + T.translation)[:, :2].mean(axis=0)
            T.translation[:2] += [0.4, 0.0] - middle
            corners = resting.vertices @ T.rotation.T + T.translation
            width = np.ptp(corners[:, 0])
            if step / width > 0.04 or stands:
                across.append(poses.stable(T, face))
            beside = pin.SE3(T.rotation, T.translation - [0.1, 0.0, 0.0])
            assert poses.stable(beside, face)
    assert len(across) > 10
    assert set(across) == {stands}


def test_objects_stay_on_slopes_where_no_push_of_2_mJ_per_kg_tips_them():
    """Against turning polygons about their edges in small steps."""
    rng = np.random.default_rng(1)
    answers = []
    for _ in range(400):
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, rng.integers(3, 7)))
        flat = rng.uniform(0.01, 0.05) * np.column_stack([np.cos(angles), np.sin(angles)])
        corners = np.column_stack([flat, np.full(len(flat), -rng.uniform(0.01, 0.2))])
        corners = corners @ upright(rng.uniform(-0.2, 0.2, 2)).T
        inside, lifted = True, np.inf
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            edge = (b - a) / np.linalg.norm(b - a)
            inside &= bool(edge[1] * a[0] - edge[0] * a[1] > 0.0)
            turns = np.linspace(0.0, np.pi / 2.0, 2000)
            along, across = (edge @ -a) * edge[2], np.cross(edge, -a)[2]  # Rodrigues, its z
            raised = along + (-a[2] - along) * np.cos(turns) + across * np.sin(turns) + a[2]
            lifted = min(lifted, raised.max())
        expected = inside and 9.81 * lifted >= 0.002
        if abs(9.81 * lifted - 0.002) > 1e-4 or not inside:
            answers.append(expected)
            assert bool(stays_standing(corners[None])[0]) == expected
    assert 0.1 < np.mean(answers) < 0.9
