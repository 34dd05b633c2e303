"""Clouds from files: read as they were written, and turned so that their table is level."""

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.__main__ import main
from benchmarks.real_clouds.pcd_file import read_pcd
from benchmarks.real_clouds.table import on_table
from placement_planner_ros.core.errors import ParameterError

POINTS = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 3)).astype(np.float32)
POINTS[7] = np.nan
HEADER = """# .PCD v0.7
VERSION 0.7
FIELDS rgb x y z
SIZE 4 4 4 4
TYPE U F F F
COUNT 1 1 1 1
WIDTH 50
HEIGHT 1
POINTS 50
DATA {}
"""
RECORDS = np.zeros(50, [("rgb", "<u4"), ("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
for axis, name in enumerate("xyz"):
    RECORDS[name] = POINTS[:, axis]


def compressed(data):
    """LZF with a repeat of zeros in front, and the rest as it is."""
    zeros = len(data) - len(data.lstrip(b"\0"))
    packed = bytearray(b"\x00\x00")  # one zero as it is
    left = zeros - 1
    while left:
        length = min(left, 264)
        if length < 9:
            packed += bytes([length - 1]) + bytes(length)  # as they are
        else:
            packed += bytes([7 << 5, length - 9, 0])  # the byte before, again and again
        left -= length
    rest = data[zeros:]
    for at in range(0, len(rest), 32):
        piece = rest[at : at + 32]
        packed += bytes([len(piece) - 1]) + piece
    return bytes(packed)


def written(folder, how):
    if how == "ascii":
        lines = [f"0 {x} {y} {z}" for x, y, z in POINTS]
        data = ("\n".join(lines) + "\n").encode()
    elif how == "binary":
        data = RECORDS.tobytes()
    else:
        whole = b"".join(RECORDS[name].tobytes() for name in ("rgb", "x", "y", "z"))
        packed = compressed(whole)
        data = np.array([len(packed), len(whole)], "<u4").tobytes() + packed
    path = folder / f"{how}.pcd"
    path.write_bytes(HEADER.format(how).encode() + data)
    return path


@pytest.mark.parametrize("how", ["ascii", "binary", "binary_compressed"])
def test_points_are_read_as_they_were_written(how, tmp_path):
    np.testing.assert_array_equal(read_pcd(written(tmp_path, how)), POINTS.astype(np.float64))


def test_what_is_no_cloud_is_refused(tmp_path, capsys):
    path = tmp_path / "a.pcd"
    path.write_bytes(b"solid\n" * 10)
    with pytest.raises(ParameterError, match="no PCD file"):
        read_pcd(path)
    for how in ("ascii", "binary", "binary_compressed"):
        whole = written(tmp_path, how).read_bytes()
        path.write_bytes(whole[: len(whole) - 100])
        with pytest.raises(ParameterError, match=r"end too early|are damaged"):
            read_pcd(path)
    assert main(["clouds", str(tmp_path / "nowhere")]) == 2
    assert "holds no .pcd files" in capsys.readouterr().err


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
