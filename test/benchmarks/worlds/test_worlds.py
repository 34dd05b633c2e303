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
def test_a_seed_draws_the_same(kind):
    first, again = world_of(kind), world_of(kind)
    assert first.urdf == again.urdf
    np.testing.assert_array_equal(first.parts[0].points, again.parts[0].points)


def test_other_seeds_draw_others_and_some_robots_with_round_links():
    worlds = [world_of("cameras", seed) for seed in range(2, 6)]
    assert len({str(world.scene.volume.lower) for world in worlds}) == 4
    round_ones = [world.urdf for world in worlds if "radius=" in world.urdf]
    assert 0 < len(round_ones) < 4
    assert all(kind in round_ones[0] for kind in ("<sphere", "<cylinder", "<capsule"))


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
