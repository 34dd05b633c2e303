"""The judge by original triangles, against plain geometry; and the planner's answers by it."""

import numpy as np
import pytest
import trimesh

from benchmarks.robots import agreement
from benchmarks.robots.agreement import RobotFiles, clutter_around, compare_answers
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.robot.model import Robot

JOINT = """
<joint name="j{n}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="{xyz}"/><axis xyz="{axis}"/>
  <limit lower="-2.5" upper="2.5" velocity="1" effort="1"/></joint>"""
MESH = """
<link name="{name}"><collision><origin xyz="{xyz}"/>
  <geometry><mesh filename="{file}" scale="{scale}"/></geometry></collision></link>"""


def prism(outline, height):
    """A closed solid over a star-shaped outline (k, 2), seen from its first corner."""
    k = len(outline)
    bottom = np.column_stack([outline, np.zeros(k)])
    fan = [[0, i + 1, i] for i in range(1, k - 1)]
    sides = [[i, (i + 1) % k, k + i] for i in range(k)]
    sides += [[(i + 1) % k, k + (i + 1) % k, k + i] for i in range(k)]
    faces = [*fan, *[[k + a, k + c, k + b] for a, b, c in fan], *sides]
    return trimesh.Trimesh(
        np.vstack([bottom, np.add(bottom, (0.0, 0.0, height))]), faces, process=False
    )


def ell():
    """An L of two arms, 6 cm wide and 6 cm thick, its inner corner first."""
    outline = [(0.06, 0.06), (0.06, 0.3), (0.0, 0.3), (0.0, 0.0), (0.25, 0.0), (0.25, 0.06)]
    return prism(np.array(outline), 0.06)


def sheet():
    """A square that is bent, open."""
    vertices = [
        (0, 0, 0),
        (0.1, 0, 0.05),
        (0.2, 0, 0),
        (0, 0.15, 0),
        (0.1, 0.15, 0.05),
        (0.2, 0.15, 0),
    ]
    return trimesh.Trimesh(vertices, [[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4]], process=False)


def tube():
    """A hollow one, with a wall of 4 mm."""
    return trimesh.creation.annulus(r_min=0.026, r_max=0.03, height=0.2, sections=24)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A robot of meshes: an L, a tube, mirrored and scaled, an open sheet; no link is convex."""
    folder = tmp_path_factory.mktemp("meshes")
    for name, mesh in (("ell", ell()), ("tube", tube()), ("sheet", sheet())):
        mesh.export(folder / f"{name}.stl")

    def link(name, mesh, xyz="0 0 0", scale="1 1 1"):
        return MESH.format(name=name, file=folder / f"{mesh}.stl", xyz=xyz, scale=scale)

    def joint(n, parent, child, xyz, axis, kind="revolute"):
        return JOINT.format(n=n, parent=parent, child=child, xyz=xyz, axis=axis, kind=kind)

    urdf = "".join(
        [
            '<robot name="meshes"><link name="base"/>',
            link("first", "ell"),
            link("second", "tube", "0 0 0.12", "1 -1 1.2"),
            link("third", "sheet", "0.02 -0.07 0"),
            link("fourth", "ell", "0.03 0 0", "-0.6 0.6 0.6"),
            '<link name="tip"/>',
            joint(1, "base", "first", "0 0 0.2", "0 0 1"),
            joint(2, "first", "second", "0.03 0.36 0.03", "1 0 0", "continuous"),
            joint(3, "second", "third", "0 0 0.29", "0 1 0"),
            joint(4, "third", "fourth", "0.26 0.03 0.02", "1 0 0"),
            '<joint name="end" type="fixed"><parent link="fourth"/><child link="tip"/></joint>',
            "</robot>",
        ]
    )
    return RobotFiles(urdf, (folder,))


@pytest.fixture(scope="module")
def planner(files):
    """The arm, all joints at zero."""
    robot = Robot.from_urdf(files.urdf)
    return MovingArm(robot, robot.arm("arm", "tip"), np.zeros(4))


def test_the_planner_agrees_with_the_triangles(files, planner):
    rng = np.random.default_rng(0)
    obstacles = clutter_around(planner, 12, rng)
    found = compare_answers(planner, files, obstacles, 2000, rng)
    assert found.wrongly_free == 0, found.wrong
    assert found.share >= 0.999
    assert 200 < found.clear < found.called_free < 1800


def test_wrong_answers_are_found(files, planner, monkeypatch):
    rng = np.random.default_rng(0)
    obstacles = clutter_around(planner, 12, rng)
    asked = ArmCollision.free_batch
    monkeypatch.setattr(agreement, "ArmCollision", lambda *a: _Wrong(ArmCollision(*a), asked))
    found = compare_answers(planner, files, obstacles, 300, rng)
    assert found.wrongly_free > 0
    assert found.share < 0.99
    assert found.wrong


class _Wrong:
    """Answers the opposite now and then."""

    def __init__(self, collision, asked):
        self._collision, self._asked = collision, asked

    def free_batch(self, Q):
        answers = self._asked(self._collision, Q)
        answers[::20] = ~answers[::20]
        return answers
