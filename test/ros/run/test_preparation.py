"""What a run gets does not depend on whether its environment was made ahead."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.snapshots import parts_of, seen

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.errors import CloudError, StartError
from placement_planner_ros.core.stopping import StoppedError
from placement_planner_ros.ros.inputs.cloud_store import PointSet
from placement_planner_ros.ros.parameters.table import arm_specs, arms_spec, fixed_specs
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.run.preparation import Preparation
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.start_checks import start_notes
from placement_planner_ros.ros.run.surroundings import Surroundings
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm

ARMS = ("left", "right")
VOLUME = [0.2, -0.3, -0.1, 0.6, 0.3, 0.2]
TABLE = np.stack(np.meshgrid(np.arange(0.2, 0.6, 0.005), np.arange(-0.3, 0.3, 0.005)), -1)
TABLE = np.column_stack([TABLE.reshape(-1, 2), np.zeros(TABLE.size // 2)])
SENSOR = np.array([0.4, 0.0, 1.0])


@pytest.fixture(scope="module")
def snapshot():
    held = object_by_name("small_crayons_box")
    specs = [
        *fixed_specs(),
        arms_spec(list(ARMS)),
        *(s for a in ARMS for s in arm_specs(a, yumi=True)),
    ]
    parameters = ParameterSet({s.name: s for s in specs})
    robot = load_yumi()
    return Snapshot(
        robot,
        tuple(yumi_arm(robot, name, grasps) for name, grasps in held.grasps.items()),
        robot.configuration(START_CONFIGURATION),
        Body.from_mesh(held.vertices, held.triangles, held.center_of_mass),
        parts_of((TABLE,), (SENSOR,)),
        parameters.changed({"target_volume": VOLUME, "seed": 3}),
        robot.root_link,
    )


def preparation(inputs=None):
    return Preparation(inputs, lambda: True)


def never():
    return False


def again(snapshot, **changes):
    """The same once more, as the node would take it: other arrays, arms made anew."""
    arms = tuple(yumi_arm(snapshot.robot, arm.name, arm.grasps) for arm in snapshot.arms)
    clouds = tuple(cloud.copy() for cloud in snapshot.clouds)
    own = {"arms": arms, "clouds": clouds, "q_start": snapshot.q_start.copy()}
    return seen(snapshot, **own | changes)


@pytest.mark.parametrize("unknown_space", ["free", "occupied"])
def test_a_run_is_the_same_whether_prepared_for_or_not(snapshot, unknown_space):
    parameters = snapshot.parameters.changed({"unknown_space": unknown_space})
    early, late = preparation(), preparation()
    early.ahead(replace(snapshot, parameters=parameters))
    ahead = early._made.environment
    one = early.prepare(again(snapshot, parameters=parameters), never)
    other = late.prepare(again(snapshot, parameters=parameters), never)
    assert one.environment is ahead
    assert other.environment is not ahead
    results = []
    for each in (one, other):
        planner = each.planner
        placements = planner.run(lambda planner=planner: planner.statistics.samples >= 300)
        results.append([(p.objective, p.trajectory.positions.tolist()) for p in placements])
    assert results[0]
    assert results[0] == results[1]


def on_the_hand(snapshot):
    """(n, 3) points of a blob around a tip: in the hand, on it and beside it."""
    tip = snapshot.robot.link_pose(snapshot.q_start, snapshot.arms[0].tip_frame).translation
    return tip + np.stack(np.meshgrid(*[np.arange(-0.08, 0.081, 0.004)] * 3), -1).reshape(-1, 3)


def contents(environment):
    """All that tells one environment from another."""
    volume, obstacles = environment.volume, environment.obstacles
    arrays = [volume.lower, volume.upper, obstacles.origin, obstacles.cells]
    return [a.tolist() for a in (*arrays, obstacles.lower, obstacles.upper)]


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({}, {"target_volume": [0.25, -0.2, -0.1, 0.6, 0.2, 0.2]}),
        ({}, {"cloud.cell_size": 0.02}),
        ({}, {"self_filter.enabled": False}),
        ({}, {"self_filter.padding": 0.1}),
        ({}, {"unknown_space": "occupied"}),
        ({"unknown_space": "occupied"}, {"collision_margin": 0.06}),
    ],
    ids=str,
)
def test_no_run_gets_an_environment_made_for_other_parameters(snapshot, before, after):
    """Nothing but one parameter has changed: not even the clouds are other arrays."""
    parameters = snapshot.parameters.changed(before)
    earlier = seen(
        snapshot,
        clouds=(np.vstack([TABLE, on_the_hand(snapshot)]),),
        origins=(SENSOR,),
        parameters=parameters,
    )
    later = replace(earlier, parameters=parameters.changed(after))
    early = preparation()
    early.ahead(earlier)
    stale = contents(early._made.environment)
    expected = contents(Surroundings.of(later).environment())
    assert stale != expected, "this parameter would make no difference"
    assert contents(early.prepare(later, never).environment) == expected
    # The same arrays and parameters again: nothing is made anew.
    made = early._made.environment
    early.prepare(replace(later), never)
    assert early._made.environment is made


@pytest.mark.parametrize(
    "after",
    [{"origins": (SENSOR + 0.3,)}, {"origins": (None,)}, {"placed": (True,)}],
    ids=["moved", "unknown", "placed"],
)
def test_no_run_gets_an_environment_seen_from_elsewhere_or_filtered_otherwise(snapshot, after):
    parameters = snapshot.parameters.changed({"unknown_space": "occupied"})
    clouds = (np.vstack([TABLE, on_the_hand(snapshot)]),)
    earlier = seen(snapshot, clouds=clouds, parameters=parameters)
    known, later = Surroundings.of(earlier), seen(earlier, **after)
    fresh = Surroundings.of(later)
    assert contents(known.environment()) != contents(fresh.environment())
    assert not Surroundings.of(later, known).same(known)
    assert Surroundings.of(replace(earlier), known) is known


def test_flying_pixels_are_left_out_and_counted(snapshot):
    clouds = (np.vstack([TABLE, [[0.45, 0.2, 0.12]]]),)
    with_eye = seen(snapshot, clouds=clouds, origins=(SENSOR,))
    assert preparation().prepare(with_eye, never).flying == 1
    assert preparation().prepare(seen(with_eye, origins=(None,)), never).flying == 0


def test_clouds_that_contradict_each_other_are_told_at_start(snapshot):
    """The second camera is 15 mm off."""
    parts = [
        PointSet(TABLE.reshape(-1, 3) + np.array([0, 0, z]), SENSOR, topic=topic, time=1.0)
        for topic, z in (("left", 0.0), ("right", 0.015))
    ]
    preparing, both = preparation(), replace(snapshot, parts=tuple(parts))
    environment = preparing.prepare(both, never).environment
    (note,) = [n for n in start_notes(both, preparing.ready(both)) if "clouds disagree" in n]
    assert "right" in note
    assert "0.0150 m above left" in note
    assert environment.obstacles.barred.any()
    alone = replace(snapshot, parts=tuple(parts[:1]))
    assert not preparing.prepare(alone, never).environment.disagreements


def test_lines_of_sight_close_sparse_surfaces_unless_an_object_stands_in_them_since(snapshot):
    sparse = TABLE.reshape(-1, 3)[(np.round(TABLE / 0.005).astype(int)[:, :2] % 2 == 0).all(axis=1)]
    # The floor beside the table: a sensor that saw nothing below tells nothing of gaps.
    beside = np.stack(np.meshgrid(np.arange(0.2, 0.6, 0.01), np.arange(0.32, 0.5, 0.01)), -1)
    floor = np.column_stack([beside.reshape(-1, 2), np.full(beside.size // 2, -0.3)])
    places = np.random.default_rng(0).uniform([0.42, 0.17, 0.0], [0.5, 0.25, 0.0], (500, 3))

    def carries(origin, *placed):
        others = (None,) * len(placed), (True,) * len(placed)
        among = seen(
            snapshot,
            clouds=(np.vstack([sparse, floor]), *placed),
            origins=(origin, *others[0]),
            placed=(False, *others[1]),
        )
        support = Surroundings.of(among).environment().support
        return support.supported(places, 0.003).mean()

    assert carries(None) < 0.02
    seen_whole = carries(SENSOR)
    assert seen_whole > 0.2
    above = places.mean(axis=0) + 0.1 * (SENSOR - places.mean(axis=0))
    thing = above + 0.15 * (np.mgrid[-1:2, -1:2, 0:2].reshape(3, -1).T)
    assert carries(SENSOR, thing) < 0.02
    assert carries(SENSOR, thing + np.array([0.0, -0.9, 0.0])) == seen_whole


def test_the_robot_matters_where_unknown_space_is_occupied(snapshot):
    parameters = snapshot.parameters.changed({"unknown_space": "occupied"})
    before = replace(snapshot, parameters=parameters)
    moved = snapshot.q_start.copy()
    moved[snapshot.arms[0].q_index] += 0.01
    known = Surroundings.of(before)
    assert Surroundings.of(again(before)).same(known)
    assert Surroundings.of(before, known) is known
    assert Surroundings.of(again(before), known) is not known
    assert not Surroundings.of(replace(before, q_start=moved), known).same(known)


def test_a_run_is_stopped_at_once_and_the_next_is_prepared(snapshot):
    preparing = preparation()
    with pytest.raises(StoppedError, match="making"):
        preparing.prepare(snapshot, lambda: True)
    assert preparing.prepare(again(snapshot), never) is not None


def test_what_fails_ahead_fails_the_run_and_is_tried_again(snapshot, monkeypatch):
    def refuse(_):
        raise CloudError("clouds", 0, "unusable")

    preparing = preparation()
    with monkeypatch.context() as patch:
        patch.setattr(Surroundings, "scene", refuse)
        preparing.ahead(snapshot)
        with pytest.raises(CloudError):
            preparing.prepare(snapshot, never)
    assert preparing.prepare(snapshot, never) is not None


def test_a_start_within_the_clouds_is_told_where_their_cells_are_known(snapshot):
    preparing = preparation()
    tip = snapshot.robot.link_pose(snapshot.q_start, snapshot.arms[0].tip_frame).translation
    block = tip + np.random.default_rng(0).uniform(-0.05, 0.05, (4000, 3))
    # A thing that stands there is not filtered as a part of the robot.
    inside = seen(
        snapshot,
        arms=snapshot.arms[:1],
        clouds=(TABLE, block),
        origins=(None, None),
        placed=(False, True),
    )
    assert start_notes(inside, preparing.ready(inside)) is not None
    preparing.ahead(inside)
    with pytest.raises(StartError, match=r"with the clouds: .* meets the environment at"):
        start_notes(inside, preparing.ready(inside))
    with pytest.raises(StartError, match="with the clouds"):
        preparing.prepare(inside, never)
