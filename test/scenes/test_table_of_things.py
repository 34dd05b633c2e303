"""The table of things: in any target volume, with things that stand on it and beside each other."""

import itertools

import numpy as np
import pytest

from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.scenes import table_of_things

VOLUMES = [([0.3, -0.4, 0.0], [0.75, 0.4, 0.45]), ([-1.0, 2.0, 0.7], [-0.6, 2.8, 1.2])]


@pytest.mark.parametrize(("lower", "upper"), VOLUMES)
def test_seven_things_stand_on_a_table_in_the_volume(lower, upper):
    volume = TargetVolume(np.array(lower), np.array(upper))
    scene = table_of_things(volume)
    table, *things = scene.parts
    top = lower[2] + 0.03
    assert len(things) == 7
    assert table.vertices[:, 2].max() == pytest.approx(top)
    for thing in things:
        assert thing.vertices[:, 2].min() == pytest.approx(top)
        middle = thing.vertices.mean(axis=0)
        assert (middle > volume.lower).all()
        assert (middle < volume.upper).all()
        assert (table.vertices.min(axis=0) < thing.vertices.min(axis=0))[:2].all()
        assert (table.vertices.max(axis=0) > thing.vertices.max(axis=0))[:2].all()
    for a, b in itertools.combinations(things, 2):
        assert a.depth(b.vertices).max() < 0.0
        assert b.depth(a.vertices).max() < 0.0
    points = complete_cloud(scene)
    assert Environment.from_points(points, volume).regions
