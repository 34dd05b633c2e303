"""Leaning: what is said to stay does, in statics of another make and in a physics engine."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from checker import Solution, SolutionChecker, Task, Tolerances, balance, check_leaning
from helpers.leaning import EYE, GREY, disturbed, leaning_poses, situations
from helpers.problems import problem_of
from helpers.tasks import yumi_task

from benchmarks.cases import Case
from placement_planner_ros.core.contacts.friction_cones import TILT_RAD, stays
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.stopping import StoppedError, stoppable
from placement_planner_ros.core.types import Contact
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.primitives import box
from placement_planner_ros.scenes.scenes import scene_by_name

SITUATIONS = situations(0)
NOTHING = {
    "slippery": "friction 0.0",
    "much asked": "stability_margin 0.",
    "bottle": "would roll",
    "plate": "would roll",
    "low wall": "too low",
    "no wall": "no wall",
    "steep": "no wall",
    "wall beyond a gap": "as near",
}
"""What is said where nothing can lean, in part."""
MOVED, TILTED = 0.008, np.deg2rad(3.0)
"""m and rad that what was released may come away."""


def task_of(situation):
    asked = replace(PlannerSettings(), **situation.settings)
    allowed = {"friction": asked.friction, "stability_margin": asked.stability_margin}
    return Task.of(situation.scene, situation.body, **allowed)


@pytest.mark.parametrize("cloud", ["complete", "camera"])
@pytest.mark.parametrize("situation", SITUATIONS, ids=lambda situation: situation.name)
def test_things_lean_where_they_can_and_nowhere_else(situation, cloud):
    rng = np.random.default_rng(1)
    contact = situation.contact(situation.environment(cloud, rng))
    found = leaning_poses(contact, rng, most=4, tries=200)
    assert bool(found) == situation.possible
    task, missing = task_of(situation), contact.missing()
    assert not [faults for T, _ in found if (faults := check_leaning(task, T, Tolerances()))]
    assert (missing is None) == bool(contact.regions)
    if situation.name in NOTHING:
        assert NOTHING[situation.name] in missing.words
    # Before a wall that is off by the tolerance the weight and half the wrench are borne, too.
    task = replace(task, stability_margin=0.5 * task.stability_margin)
    for T, feature in found:
        with pytest.raises(StoppedError), stoppable(lambda: True):
            contact.held(T[None], np.array([feature]))
        out = contact.opening(feature)[:2] / np.linalg.norm(contact.opening(feature)[:2])
        for off in (-0.003, 0.003):
            at = contact.moved(pin.SE3(T), Contact(feature, 0.0), np.array([*(off * out), 0.0]))
            assert not check_leaning(task, at.homogeneous, Tolerances())


@pytest.mark.parametrize(("cloud", "behind"), [("camera", False), ("complete", True)])
def test_nothing_leans_behind_a_wall_that_was_seen_from_before_it(cloud, behind):
    """There may be more of it; where nobody says from where it was seen, both sides are walls,
    each where it is, however thin."""
    panel = box("panel", (0.67, -0.6, 0.08), (0.672, 0.6, 0.6), GREY)
    hanging = replace(SITUATIONS[0], parts=(SITUATIONS[0].parts[0], panel))
    contact = hanging.contact(hanging.environment(cloud, np.random.default_rng(1)))
    used = [contact._walls[contact._wall_of[feature]] for feature in range(len(contact.frames))]
    assert used
    assert any(wall.normal @ EYE < wall.offset for wall in used) == behind
    for wall in used:
        assert wall.offset == pytest.approx(0.672 if wall.normal[0] > 0.0 else -0.67, abs=5e-4)


@pytest.mark.parametrize(
    ("thing", "settings", "words"),
    [  # of one corner above, asked too much, too thick, round, too thin
        (trimesh.creation.cone(0.07, 0.2, sections=3), {}, "one corner"),
        (SITUATIONS[0].thing, {"stability_margin": 1.0}, "stability_margin 1, but with 0"),
        (trimesh.creation.box((0.1, 0.1, 0.1)), {"friction": 2.0}, "stability_margin 0.05, but"),
        (trimesh.creation.icosphere(2, 0.05), {}, "roll"),
        (trimesh.creation.cylinder(0.012, 0.25, sections=6), {}, "off by less than contact_toler"),
    ],
)
def test_only_what_would_help_is_said_to_lack(thing, settings, words):
    situation = replace(SITUATIONS[0], thing=thing, settings=settings)
    contact = situation.contact(situation.environment("complete", np.random.default_rng(1)))
    assert words in contact.missing().words


@pytest.mark.parametrize(
    "situation", [s for s in SITUATIONS if s.possible], ids=lambda situation: situation.name
)
def test_what_leans_stays_when_it_is_let_go(situation):
    pytest.importorskip("mujoco")
    from helpers.settle import settle

    rng = np.random.default_rng(2)
    contact = situation.contact(situation.environment("complete", rng))
    body, solids = situation.body, [part.vertices for part in situation.parts]
    pieces = [np.asarray(piece.vertices) for piece in situation.thing.split()]
    friction = situation.settings.get("friction", 0.3)
    for T, _ in leaning_poses(contact, rng, most=2):
        for factor in (1.0, 1.5):
            x = disturbed(T, body.center_of_mass, rng)
            result = settle(
                solids, pieces, body.center_of_mass, x, friction=factor * friction, noslip=10
            )
            assert result.moved < MOVED
            assert result.tilted < TILTED


def ladder(angle, half_width=0.1, length=0.3):
    """Contacts of a plank that leans by an angle from the vertical against the plane x = 0, and
    its centre of mass."""
    run, rise = length * np.sin(angle), length * np.cos(angle)
    floor = np.array([[run, y, 0.0] for y in (-half_width, half_width)])
    wall = np.array([[0.0, y, rise] for y in (-half_width, half_width)])
    return floor, wall, 0.5 * np.array([run, 0.0, rise])


@pytest.mark.parametrize("friction", [0.2, 0.3, 0.6])
def test_a_plank_stays_as_far_as_friction_of_the_floor_says(friction):
    """Pushed away from the wall, the floor has to hold half the push and tan(angle) / 2. Upright
    it would fall away from the wall."""
    margin, out = 0.05, np.array([1.0, 0.0, 0.0])
    steepest = np.arctan(2.0 * friction - (margin + np.tan(TILT_RAD)))
    shares = (0.05 / steepest, False), (0.5, True), (0.8, True), (1.01, False), (1.5, False)
    for share, expected in shares:
        floor, wall, center = ladder(share * steepest)
        assert stays(floor, wall, 0.0, center, friction, margin) == expected
        if expected:
            points, up = np.vstack([floor, wall]), [0.0, 0.0, 1.0]
            normals = np.array([up, up, out, out])
            assert not balance(points, normals, center, friction, margin)


def test_however_rough_the_floor_nothing_leans_so_far_that_its_foot_is_thrown_out():
    """A board of more than 45 degrees that falls against the wall by 2 mm may come to lie."""
    rough = replace(SITUATIONS[1], settings={"friction": 1.0})
    contact = rough.contact(rough.environment("complete", np.random.default_rng(1)))
    for feature, (_, reach) in enumerate(contact._features):
        wall = contact._walls[contact._wall_of[feature]]
        foot = (wall.offset + reach.farthest) * wall.normal
        T = contact.poses(np.array([feature]), foot[None], np.zeros(1), None)[0]
        assert T[2, 3] - foot[2] > np.linalg.norm(T[:2, 3] - foot[:2])


@pytest.fixture(scope="module")
def leaning():
    """A crayons box that the robot leans on the back wall of the cabinet, with what was asked."""
    case = Case("cabinet_high_clutter", "small_crayons_box", "maximize_clearance")
    problem, objective = problem_of(case)
    settings = PlannerSettings(contacts=("lean",))
    planner = PlacementPlanner(problem, objective, settings, np.random.default_rng(7))
    placements = list(
        planner.run(
            lambda: planner.statistics.solutions >= 2 or planner.statistics.samples >= 20_000
        )
    )
    return case, problem, planner, placements


def test_a_robot_leans_a_box_and_another_program_agrees(leaning):
    case, problem, _, placements = leaning
    assert placements
    settings = PlannerSettings()
    task = yumi_task(
        scene_by_name(case.scene),
        object_by_name(case.object),
        q_start=dict(zip(problem.robot.joint_names, problem.q_start.tolist(), strict=True)),
        friction=settings.friction,
        stability_margin=settings.stability_margin,
    )
    checker = SolutionChecker(task, Tolerances(acceleration_limit=np.inf))
    arms = {arm.name: arm for arm in problem.arms}
    for placement in placements:
        assert placement.resting.contact == "lean"
        assert "wall" in placement.resting.on
        assert placement.goal.opening[2] == pytest.approx(np.sqrt(0.5), abs=0.01)
        assert checker.check(Solution.of(placement, arms[placement.arm])) == []


def test_what_leans_is_moved_along_the_wall_and_to_and_from_it(leaning):
    _, _, planner, placements = leaning
    goal, contacts = placements[0].goal, planner._poses.contacts
    out = contacts.opening(goal.face)[:2] / np.linalg.norm(contacts.opening(goal.face)[:2])
    for change in (0.004 * np.array([-out[1], out[0]]), 0.001 * out, -0.001 * out):
        moved = contacts.moved(goal.T_world_object, goal.contact, np.array([*change, 0.3]))
        resting = contacts.resting(moved, goal.face)
        before = contacts.resting(goal.T_world_object, goal.face)
        assert len(resting.points) == len(before.points)
        foot = resting.points[resting.normals[:, 2] > 0.5].mean(axis=0)
        was = before.points[before.normals[:, 2] > 0.5].mean(axis=0)
        np.testing.assert_allclose(foot - was, [*change, 0.0], atol=1e-9)
    away = contacts.moved(goal.T_world_object, goal.contact, np.array([*(2.0 * out), 0.0]))
    assert away is None
