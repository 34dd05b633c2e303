"""What a run gets does not depend on whether its environment was made ahead."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from helpers.fakes import TABLE
from helpers.snapshots import seen, yumi_snapshot

from placement_planner_ros.core.errors import StartError
from placement_planner_ros.ros.inputs.cloud_store import PointSet
from placement_planner_ros.ros.inputs.known_surface import surface_points
from placement_planner_ros.ros.run.preparation import Preparation
from placement_planner_ros.ros.run.start_checks import start_notes
from placement_planner_ros.ros.run.surroundings import Surroundings
from placement_planner_ros.scenes.yumi import yumi_arm

SENSOR = np.array([0.4, 0.0, 1.0])


@pytest.fixture(scope="module")
def snapshot():
    return yumi_snapshot(("left", "right"), (TABLE,), (SENSOR,))


def preparation(inputs=None):
    return Preparation(inputs, lambda: True)


def never():
    return False


def again(snapshot, **changes):
    """The same once more, as the node would take it: arms and q_0 made anew."""
    arms = tuple(yumi_arm(snapshot.robot, arm.name, arm.grasps) for arm in snapshot.arms)
    return replace(snapshot, arms=arms, q_start=snapshot.q_start.copy(), **changes)


@pytest.mark.parametrize("unknown_space", ["free", "occupied"])
def test_a_run_is_the_same_whether_prepared_for_or_not(snapshot, unknown_space):
    parameters = snapshot.parameters.changed({"unknown_space": unknown_space})
    early, late = preparation(), preparation()
    early.ahead(replace(snapshot, parameters=parameters))
    ahead = early._made.environment
    one = early.prepare(again(snapshot, parameters=parameters), never)
    other = late.prepare(again(snapshot, parameters=parameters), never)
    assert one.environment is ahead
    noisy = replace(early._made.surroundings.snapshot, q_start=snapshot.q_start + 1e-4)
    assert early.ready(noisy) is ahead
    assert other.environment is not ahead
    results = []
    for planner in (one, other):
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
    with pytest.raises(StartError, match=r"with the surroundings: .* meets an obstacle at"):
        start_notes(inside, preparing.ready(inside))
    with pytest.raises(StartError, match="with the surroundings"):
        preparing.prepare(inside, never)


def test_a_known_table_lets_no_camera_pass_for_one_without_noise(snapshot):
    rng = np.random.default_rng(0)
    board = trimesh.creation.box(bounds=[[0.2, -0.3, -0.04], [0.6, 0.3, 0.0]])
    top = TABLE.reshape(-1, 3) + rng.normal(0.0, 0.0015, (TABLE.size // 3, 3))
    both = seen(
        snapshot,
        clouds=(top, surface_points(np.asarray(board.triangles))),
        origins=(SENSOR, None),
        placed=(False, True),
    )
    measured = Surroundings.of(both).environment().measured
    assert measured.noise == pytest.approx(0.0015, rel=0.2)
    tops = measured.upper[:, 2]
    assert (np.abs(tops) < 0.001).sum() > 1000
    assert (tops > 0.002).mean() < 0.01
