"""Clouds from files are turned so that their table is level."""

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.__main__ import main
from benchmarks.real_clouds.table import on_table


def test_a_folder_without_clouds_is_named(tmp_path, capsys):
    assert main(["clouds", str(tmp_path)]) == 2
    assert "holds no .ply files" in capsys.readouterr().err


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.3, -0.2, 2.0)])
def test_the_table_is_found_and_put_before_the_robot(turn):
    rng = np.random.default_rng(0)
    table = np.column_stack([rng.uniform(-0.4, 0.4, (20_000, 2)), rng.normal(0, 0.001, 20_000)])
    can = np.column_stack([rng.uniform(-0.04, 0.04, (2_000, 2)), rng.uniform(0.0, 0.2, 2_000)])
    sensor = np.array([-0.7, 0.1, 0.6])
    T_sensor_world = pin.SE3(pin.rpy.rpyToMatrix(*turn), np.zeros(3))
    seen = (np.vstack([table, can, [[np.nan] * 3]]) - sensor) @ T_sensor_world.rotation.T
    found = on_table(seen, rng)
    assert len(found.points) == 22_000
    heights = found.points[:20_000, 2]
    assert abs(np.median(heights)) < 5e-4
    assert heights.std() < 0.0015
    assert found.points[20_000:, 2].max() == pytest.approx(0.2, abs=0.002)  # upwards
    assert found.sensor[2] == pytest.approx(0.6, abs=0.002)
    assert found.sensor[0] < found.volume.lower[0]
    nearest = found.points[:20_000, 0].min()
    assert nearest == pytest.approx(found.volume.lower[0], abs=0.05)
