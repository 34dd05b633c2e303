"""The shapes of links are made once for each mesh, and kept for the next process."""

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core import disk_cache
from placement_planner_ros.core.collision import link_shapes, mesh_shapes, spheres
from placement_planner_ros.core.robot.model import Robot

LINK = """<link name="{0}"><collision><geometry><mesh filename="ring.stl"/></geometry></collision>
</link>"""
URDF = f"""<robot name="rings">{LINK.format("a")}{LINK.format("b")}
<link name="c"><collision><geometry><box size="1 1 1"/></geometry></collision></link>
<joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>
<joint name="bc" type="fixed"><parent link="b"/><child link="c"/></joint></robot>"""


@pytest.fixture
def robot(monkeypatch, tmp_path):
    """Reads the robot, and counts what is made."""
    trimesh.creation.annulus(0.1, 0.15, 0.04, sections=12).export(tmp_path / "ring.stl")
    monkeypatch.setattr(disk_cache, "cache_folder", lambda: tmp_path / "kept")
    made = []
    for module, name in ((mesh_shapes, "covered_mesh"), (spheres, "_one_sphere_tree")):
        original = getattr(module, name)

        def counted(*given, original=original, name=name):
            made.append(name)
            return original(*given)

        monkeypatch.setattr(module, name, counted)

    def read():
        return Robot.from_urdf(URDF, [tmp_path])

    return read, made


def same(a, b):
    """Whether two shapes hold the same numbers."""
    arrays = ("boxes", "leaves", "corners", "closed", "components")
    assert all(np.array_equal(getattr(a.mesh, n), getattr(b.mesh, n)) for n in arrays)
    assert a.mesh.digest == b.mesh.digest
    assert a.excess == b.excess
    assert len(a.sets) == len(b.sets) > 1
    for one, other in zip(a.sets, b.sets, strict=True):
        assert np.array_equal(one.vertices, other.vertices)
        assert np.array_equal(one.normals, other.normals)
        assert np.array_equal(one.offsets, other.offsets)


def test_a_mesh_of_two_links_is_one_shape_and_made_once_for_all_processes(robot):
    read, made = robot
    first, second, box = link_shapes.link_shapes(read())
    assert first is second
    assert box.mesh is None
    assert made == ["covered_mesh"]
    again, _, _ = link_shapes.link_shapes(read())
    assert again is not first
    assert made == ["covered_mesh"]
    same(again, first)
    cover = read().covers[0]
    same(again, mesh_shapes.covered_mesh(cover, cover.mesh.vertices, cover.mesh.triangles))
