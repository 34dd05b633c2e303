"""The judge by original triangles, against plain geometry; and the planner's answers by it."""

import numpy as np
import pytest
import trimesh

from benchmarks.robots import agreement
from benchmarks.robots.agreement import (
    RobotFiles,
    clutter_around,
    compare_answers,
)
from benchmarks.robots.triangles import Boxes, TriangleRobot, components, winding_number
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.moving_arm import MovingArm

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
    robot = Robot.from_urdf(files.urdf, files.package_dirs)
    return MovingArm(robot, robot.arm("arm", "tip"), np.zeros(4))


def test_components_are_told_apart_and_closed_ones_from_sheets():
    apart = trimesh.util.concatenate([ell(), sheet().apply_translation((1.0, 0.0, 0.0))])
    soup = apart.vertices[apart.faces].reshape(-1, 3)  # as an STL has it
    closed, opened = sorted(
        components(soup, np.arange(len(soup)).reshape(-1, 3)), key=lambda c: not c.closed
    )
    assert (closed.closed, opened.closed) == (True, False)
    assert (len(closed.corners), len(opened.corners)) == (len(ell().faces), 4)
    assert closed.encloses(np.array([0.03, 0.2, 0.03]))
    assert not closed.encloses(np.array([0.1, 0.1, 0.03]))  # beside the inner corner
    assert not opened.encloses(np.array([1.1, 0.07, 0.02]))


@pytest.mark.parametrize("mesh", [ell(), tube()], ids=["L", "tube"])
def test_winding_numbers_are_those_of_the_solid(mesh):
    rng = np.random.default_rng(0)
    low, high = mesh.bounds
    for point in rng.uniform(low, high, (200, 3)):
        if mesh.body_count == 1 and mesh.faces.shape[0] < 100:
            inside = point[0] < 0.06 or point[1] < 0.06
        else:
            inside = 0.026 < np.hypot(*point[:2]) < 0.03
            if abs(np.hypot(*point[:2]) - 0.028) > 0.0015:
                continue  # the walls are of 24 flat pieces
        assert abs(winding_number(mesh.vertices[mesh.faces], point)) == pytest.approx(
            float(inside), abs=1e-6
        )


def brute_force(judge, lower, upper):
    """Least distance of points on the triangles, and in the solids, from boxes."""
    rng, best = np.random.default_rng(0), np.inf
    for i, thing in enumerate(judge.things):
        for part in thing.components:
            weights = rng.dirichlet(np.ones(3), (len(part.corners), 150))
            points = np.einsum("tnk,tkd->tnd", weights, part.corners).reshape(-1, 3)
            T = judge.placement(i)
            points = points @ T.rotation.T + T.translation
            away = np.maximum(np.maximum(lower - points[:, None], points[:, None] - upper), 0.0)
            best = min(best, float(np.linalg.norm(away, axis=2).min()))
    return best


def test_the_judge_is_right_about_boxes(files, planner):
    arm = planner.arm
    judge = TriangleRobot(files.urdf, files.package_dirs, arm.joints, ())
    rng = np.random.default_rng(1)
    seen = set()
    for _ in range(60):
        judge.place(dict(zip(arm.joints, rng.uniform(-2.5, 2.5, 4), strict=True)))
        middle = rng.normal((0.0, 0.0, 0.4), 0.3, (3, 3))
        lower, upper = middle - 0.02, middle + 0.02
        about = brute_force(judge, lower, upper)
        assert judge.near_boxes(Boxes(lower, upper), about + 1e-6)
        if about > 0.02:  # so that the samples are dense enough, and no box lies inside
            assert not judge.near_boxes(Boxes(lower, upper), about - 0.012)
        seen.add(about > 0.02)
    assert seen == {True, False}


def test_links_within_links_meet(tmp_path):
    small, large = tmp_path / "small.stl", tmp_path / "large.stl"
    trimesh.creation.box((0.02, 0.02, 0.02)).export(small)
    trimesh.creation.box((0.2, 0.2, 0.2)).export(large)
    slides = {"xyz": "0 0 0", "axis": "1 0 0", "kind": "prismatic"}
    urdf = "".join(
        [
            '<robot name="nested"><link name="base"/>',
            MESH.format(name="outer", file=large, xyz="0 0 0", scale="1 1 1"),
            MESH.format(name="inner", file=small, xyz="0 0 0", scale="1 1 1"),
            JOINT.format(n=1, parent="base", child="outer", **slides),
            JOINT.format(n=2, parent="outer", child="inner", **slides),
            "</robot>",
        ]
    )
    pairs = [frozenset({"outer", "inner"})]
    judge = TriangleRobot(urdf, (), ("j1", "j2"), pairs)
    for x, meets in ((0.0, True), (0.1, True), (0.111, False)):
        judge.place({"j1": 0.3, "j2": x})
        assert bool(judge.near_itself(0.0)) is meets
        assert judge.near_itself(0.002)
    judge.place({"j1": 0.3, "j2": 0.113})
    assert not judge.near_itself(0.002)
    # A box that is wholly inside of a link, and one beside it.
    at = np.array([[0.35, 0.0, 0.0]])
    assert judge.near_boxes(Boxes(at - 0.001, at + 0.001), 0.0)
    assert not judge.near_boxes(Boxes(at + 0.2, at + 0.21), 0.003)


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
