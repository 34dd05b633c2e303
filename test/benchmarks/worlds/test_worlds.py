"""Worlds whose descriptions and clouds tell less than the truth, and who judges motions in them."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.worlds.command import WorldJob, _generator, _judge_of, _searched, worlds_table
from benchmarks.worlds.kinds import KINDS
from placement_planner_ros.scenes.primitives import box
from placement_planner_ros.scenes.scenes import Scene


def world_of(kind, seed=0):
    return KINDS[kind](_generator(WorldJob(kind, seed, 1.0, 1)))


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_draws_the_same_and_another_one_others(kind):
    first, again, other = world_of(kind), world_of(kind), world_of(kind, 1)
    assert first.urdf == again.urdf
    np.testing.assert_array_equal(first.parts[0].points, again.parts[0].points)
    assert first.scene.volume.lower.tolist() != other.scene.volume.lower.tolist()


def test_the_judge_looks_at_the_true_world():
    job = WorldJob("quaternions", 0, 60.0, 1)
    world = KINDS[job.kind](_generator(job))
    ((snapshot, placement),), _, _ = _searched(world.snapshot(0), job)
    assert _judge_of(world)(snapshot, placement) == []
    at = placement.T_world_object.translation
    unseen = box("unseen", (at - 0.02).tolist(), (at + 0.02).tolist(), (0.5, 0.5, 0.5))
    scene = Scene("other", world.scene.volume, (*world.scene.parts, unseen))
    faults = _judge_of(replace(world, scene=scene))(snapshot, placement)
    assert any(fault.startswith("collision: object with unseen") for fault in faults)


def test_the_table_counts_motions_and_worlds():
    cut = {"objective": 0.1, "faults": ["collision: a with b", "collision: a with c"]}
    right = {"objective": 0.2, "faults": []}
    known = {"name": "n", "must_place": True, "notes": []}
    entries = [
        {**known, "motions": [cut, right], "possible": True},
        {**known, "motions": [], "possible": True},
        {**known, "motions": [], "possible": False},
    ]
    assert "| n | 3 | 2 | 1 | 0 | 0 | 0 | 1 of 2 | 0 |" in worlds_table(entries)
