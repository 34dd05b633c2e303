"""What the planner takes for rests holds in a physics engine, and what holds there is found."""

import numpy as np
import pytest
import trimesh

pytest.importorskip("mujoco")

from by_hand.settle_objects import Thing, compared, objects, summary
from helpers.drops import Drops, mass_of
from helpers.scans import SHAPES, finer, noisy


def scan(name, triangles, seed):
    return Thing(noisy(finer(SHAPES[name](), triangles), 0.001, np.random.default_rng(seed)))


@pytest.mark.parametrize("name", ["toy_table", "bulging box", "cylinder of 32", "drill", "banana"])
def test_rests_of_shapes_are_those_of_physics(name):
    row = compared(objects()[name], falls=30, yaws=4, rng=np.random.default_rng(1))
    assert row["offered"]
    assert all(rest["held"] == rest["tries"] and rest["firm"] for rest in row["offered"])
    told = summary({name: row})
    assert told["of those found"] == told["rests that hold, and under a push"] > 0
    assert (told["of these, only to roll"] > 0) == name.startswith("cylinder")


@pytest.mark.parametrize("name", ["tall box", "hollow bowl", "bottle"])
def test_rests_of_scans_are_those_of_physics(name):
    row = compared(scan(name, 5000, 2), falls=30, yaws=4, rng=np.random.default_rng(1))
    told = summary({name: row})
    assert told["rests offered"] > 0
    assert told["of these that do not hold"] == 0
    assert told["of those found"] == told["rests that hold, and under a push"] > 0


def test_a_drop_tells_what_holds_from_what_does_not():
    box = trimesh.creation.box((0.02, 0.06, 0.10))
    drops = Drops(np.asarray(box.vertices), mass_of(box))
    down = np.array([0.0, 0.0, -1.0])
    stays = drops.drop(down, 0.4, 0.001)
    assert stays.still
    assert stays.down @ down > 0.9999
    leaning = np.array([np.sin(0.3), 0.0, -np.cos(0.3)])  # its edge is at 0.197 rad
    falls = drops.drop(leaning, 0.4, 0.001)
    assert falls.down @ [1.0, 0.0, 0.0] > 0.99
    assert drops.drop(down, 0.4, 0.0, push=1.0).down @ down < 0.1
