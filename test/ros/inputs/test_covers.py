"""Covers are made in another process; where that does not do, the hull stands in and is told."""

import resource
from functools import partial

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core import disk_cache
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.ros.inputs.mesh_process import MeshProcess, cover_in

URDF = """<robot name="ring"><link name="base"><collision><geometry>
<mesh filename="ring.stl"/></geometry></collision></link></robot>"""


@pytest.fixture
def folder(monkeypatch, tmp_path):
    trimesh.creation.annulus(0.1, 0.15, 0.04, sections=12).export(tmp_path / "ring.stl")
    monkeypatch.setattr(disk_cache, "cache_folder", lambda: tmp_path / "kept")
    return tmp_path


def read(folder, process):
    return Robot.from_urdf(URDF, {"": folder}, cover=partial(cover_in, process))


def coarse(robot):
    """Whether the hull stands in, which users are told."""
    (mesh,) = robot.meshes
    told = [words for words in robot.warnings if "its convex cover reaches" in words]
    assert len(told) == int(len(mesh.cover.parts) == 1)
    return bool(told) and "link base" in told[0] and "a simpler mesh" in told[0]


def test_a_cover_that_takes_too_much_memory_is_the_hull_and_that_is_told(folder):
    with MeshProcess() as process:
        vertices = np.asarray(process.read(folder / "ring.stl")[0])
        assert len(vertices)
        little = 10_000_000
        resource.prlimit(process._child.pid, resource.RLIMIT_DATA, (little, little))
        assert coarse(read(folder, process))
        process.close()
        assert not coarse(read(folder, process))
