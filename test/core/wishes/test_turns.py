"""Which turns keep `up` and `front`: ranges of θ, and what is published."""

import numpy as np
import pinocchio as pin
import pytest
from helpers import few_joints
from helpers.problems import problem_of
from helpers.tilts import tilted_problem

from benchmarks.cases import Case
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.sample_goals.remainder import Cause
from placement_planner_ros.core.types import upright
from placement_planner_ros.core.wishes.settings import TurnSettings
from placement_planner_ros.core.wishes.turns import Turns

TABLE = Case("table", "small_crayons_box", "maximize_clearance")
SAMPLERS = ("optimistic", "mcts", "uniform")


@pytest.fixture(scope="module")
def table():
    return problem_of(TABLE)


def planner_of(made, turns, seed=0, **settings):
    problem, objective = made
    chosen = PlannerSettings(turns=turns, **settings)
    return PlacementPlanner(problem, objective, chosen, np.random.default_rng(seed))


def off_by(x, turns):
    """rad by which a pose's `up` leans, and its `front` faces elsewhere, by vectors alone."""
    up = x.rotation @ turns.up / np.linalg.norm(turns.up) if turns.up else np.array([0, 0, 1.0])
    lean = np.arccos(np.clip(up[2], -1.0, 1.0))
    if not turns.front:
        return lean, 0.0
    front = (x.rotation @ turns.front)[:2]
    target = np.array([np.cos(turns.front_direction), np.sin(turns.front_direction)])
    return lean, np.arccos(np.clip(front @ target / np.linalg.norm(front), -1.0, 1.0))


@pytest.mark.parametrize("seed", range(4))
def test_ranges_are_the_angles_that_keep_the_rules_and_no_others(table, seed):
    rng = np.random.default_rng(seed)
    faces = table[0].body.faces
    settings = TurnSettings(
        up=tuple(rng.normal(size=3)) if seed % 4 != 1 else (),
        up_tolerance=rng.uniform(0.2, 2.0),
        front=tuple(rng.normal(size=3)) if seed % 4 != 2 else (),
        front_direction=rng.uniform(-9.0, 9.0),
        front_tolerance=rng.uniform(0.0, np.pi),
    )
    turns = Turns(settings, faces)
    angles = rng.uniform(0.0, 2.0 * np.pi, 2000)
    for face in range(len(faces)):
        slope = tuple(rng.normal(0.0, 0.15 * (seed % 3 > 0), 2).tolist())
        about = [pin.utils.rotate("z", angle) for angle in angles]
        rotations = upright(slope) @ np.array(about) @ faces[face].T_face_object.rotation
        leans, away = np.transpose([off_by(pin.SE3(R, np.zeros(3)), settings) for R in rotations])
        kept = (leans <= settings.up_tolerance) & (away <= settings.front_tolerance)
        if settings.front:
            facing = rotations @ (np.array(settings.front) / np.linalg.norm(settings.front))
            kept &= np.hypot(facing[:, 0], facing[:, 1]) >= np.sin(np.radians(5.0))
        within = np.zeros(len(angles), bool)
        for low, high in turns.ranges(face, slope):
            assert 0.0 <= low < high <= low + 2.0 * np.pi + 1e-12
            within |= np.remainder(angles - low, 2.0 * np.pi) <= high - low
        assert (within == kept).mean() > 0.998  # but within rounding of an end
        assert (turns.kept(rotations) == kept).mean() > 0.998


def test_nothing_asked_leaves_every_turn_and_a_tolerance_of_nothing_leaves_one(table):
    faces = table[0].body.faces
    face = faces[0]
    exact = TurnSettings(up=tuple(-face.normal), up_tolerance=0.0)
    assert Turns(exact, faces).ranges(0, (0.0, 0.0)) == ((0.0, 2.0 * np.pi),)
    along = face.T_face_object.rotation.T @ [1.0, 0.0, 0.0]
    front = TurnSettings(front=tuple(along), front_direction=0.5, front_tolerance=0.0)
    ((low, high),) = Turns(front, faces).ranges(0, (0.0, 0.0))
    assert low < 0.5 < high < low + 1e-5


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_what_is_published_is_turned_as_asked(table, sampler):
    face = table[0].body.faces[2]
    along = face.T_face_object.rotation.T @ [1.0, 0.0, 0.0]
    turns = TurnSettings(
        up=tuple(-face.normal), front=tuple(along), front_direction=1.2, front_tolerance=0.2
    )
    planner = planner_of(table, turns, sampler=sampler)
    placements = list(planner.run(lambda: planner.statistics.samples >= 1500))
    assert len(placements) >= 1
    for placement in placements:
        lean, away = off_by(placement.T_world_object, turns)
        assert lean <= turns.up_tolerance
        assert away <= turns.front_tolerance + 2e-6
    assert planner.statistics.rejected["breaks_rule"] == 0  # drawn within, not refused


def test_on_a_tilted_table_the_lean_counts():
    made = tilted_problem(TABLE, 4.0, 0.7, np.random.default_rng(0))
    up = tuple(-made[0].body.faces[2].normal)
    planner = planner_of(made, TurnSettings(up=up, up_tolerance=0.05))
    assert planner.cause is Cause.NO_FACE
    assert "keeps `up`; try `up`: leave it out" in planner.exhausted
    planner = planner_of(made, TurnSettings(up=up, up_tolerance=0.08))
    placement = next(planner.run(lambda: planner.statistics.samples >= 1500))
    assert 0.05 < off_by(placement.T_world_object, TurnSettings(up=up))[0] <= 0.08


@pytest.mark.parametrize("name", ["five", "scara"])
def test_arms_that_say_themselves_how_the_object_is_turned_keep_it(name):
    scene = few_joints.table()
    held = few_joints.FROM_ABOVE if name == "scara" else few_joints.FROM_ASIDE
    made = few_joints.made(name, held, scene, few_joints.environment_of(scene))[:2]
    turns = TurnSettings(
        up=(0.0, 0.0, 1.0), front=(1.0, 0.0, 0.0), front_direction=0.3, front_tolerance=0.4
    )
    planner = planner_of(made, turns)
    placements = list(planner.run(lambda: planner.statistics.samples >= 1500))
    assert len(placements) >= 1
    for placement in placements:
        lean, away = off_by(placement.T_world_object, turns)
        assert lean <= turns.up_tolerance
        assert away <= turns.front_tolerance + 2e-6
