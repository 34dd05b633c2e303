"""A robot's mesh files: each kind loads, mirrored ones face outward, all that is wrong is told."""

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot import geometry
from placement_planner_ros.core.robot.model import Robot

# Not convex, so that its triangles are kept.
LOWER = trimesh.creation.box(bounds=[[0, 0, 0], [0.3, 0.1, 0.1]])
UPPER = trimesh.creation.box(bounds=[[0, 0.2, 0], [0.1, 0.3, 0.1]])
TWO = trimesh.util.concatenate([LOWER, UPPER])


def urdf(*meshes):
    links = "".join(
        f'<link name="l{n}"><collision><geometry><mesh {mesh}/></geometry></collision></link>'
        for n, mesh in enumerate(meshes)
    )
    joints = "".join(
        f'<joint name="j{n}" type="fixed"><parent link="l0"/><child link="l{n}"/></joint>'
        for n in range(1, len(meshes))
    )
    return f'<robot name="r">{links}{joints}</robot>'


def triangles(robot, number=0):
    shape = robot.geometry.geometryObjects[number].geometry
    points = np.array(shape.vertices()).reshape(-1, 3)
    rows = [shape.tri_indices(i) for i in range(shape.num_tris)]
    return trimesh.Trimesh(points, [[t[0], t[1], t[2]] for t in rows], process=False)


@pytest.mark.parametrize("scale", ["-1 1 1", "1 1 -1", "-1 -1 -1", "-1 -1 1", "1 1 1"])
def test_a_mirrored_mesh_faces_outward(tmp_path, scale):
    TWO.export(tmp_path / "a.stl")
    mesh = triangles(Robot.from_urdf(urdf(f'filename="a.stl" scale="{scale}"'), {"": tmp_path}))
    assert mesh.volume == pytest.approx(TWO.volume)


def test_what_is_too_large_is_refused_with_its_number(tmp_path, monkeypatch):
    for name in ("a.stl", "b.stl"):
        TWO.export(tmp_path / name)
    monkeypatch.setattr(geometry, "MAX_ALL_TRIANGLES", 47)
    words = r"b\.stl.*too many triangles, 48 with the meshes before it; .* have 47: use simpler"
    with pytest.raises(RobotError, match=words):
        Robot.from_urdf(urdf('filename="a.stl"', 'filename="b.stl"'), {"": tmp_path})
    Robot.from_urdf(urdf('filename="a.stl"', 'filename="a.stl"'), {"": tmp_path})
