"""MotionBenchMaker problems of a robot and scenes the project did not make."""

from itertools import pairwise

import coal
import numpy as np
import pinocchio as pin
import pytest
from helpers.shared import SHARED

from benchmarks.motion.comparison import Workbench, path_length
from benchmarks.motion.problems import panda_problems, read_problem
from placement_planner_ros.core.errors import JointStateError, ParameterError
from placement_planner_ros.core.timing.timing import evaluate_trajectory

DATA = SHARED / "data"
SOME = ("bookshelf_small/0009", "table_pick/0005")
STEP = 0.02
"""rad between checked states, norm over the joints."""


@pytest.fixture(scope="module")
def problems():
    if not (DATA / "problems").is_dir():
        pytest.skip("needs the shared problems")
    return {problem.name: problem for problem in panda_problems(DATA)}


class TrueWorld:
    """The robot's own geometry among the exact primitives, all by coal."""

    def __init__(self, problem):
        self.problem = problem
        self.robot = problem.robot
        self.data = self.robot.model.createData()
        self.shapes = self.robot.geometry.createData()
        self.things = [
            (
                coal.Box(*p.size) if p.kind == "box" else coal.Cylinder(p.size[1], p.size[0]),
                coal.Transform3s(p.T_world_primitive.rotation, p.T_world_primitive.translation),
            )
            for p in problem.primitives
        ]
        base = {self.robot.geometry_links[0]}
        self.moving = [i for i, link in enumerate(self.robot.geometry_links) if link not in base]

    def hits(self, q_arm):
        q = np.array(self.problem.q_start)
        q[self.problem.arm.q_index] = q_arm
        robot = self.robot
        if pin.computeCollisions(robot.model, self.data, robot.geometry, self.shapes, q, True):
            return "the robot meets itself"
        for i in self.moving:
            T = self.shapes.oMg[i]
            shape = robot.geometry.geometryObjects[i].geometry
            placed = coal.Transform3s(T.rotation, T.translation)
            for (thing, where), primitive in zip(self.things, self.problem.primitives, strict=True):
                if coal.collide(
                    shape, placed, thing, where, coal.CollisionRequest(), coal.CollisionResult()
                ):
                    return f"{robot.geometry_links[i]} meets {primitive.name}"
        return ""


def dense(path):
    """States along a polyline no further than STEP apart."""
    pieces = [
        a + np.linspace(0, 1, int(np.linalg.norm(b - a) / STEP) + 2)[:, None] * (b - a)
        for a, b in pairwise(path)
    ]
    return np.vstack(pieces)


def test_all_are_read_with_their_notes(problems):
    assert len(problems) == 40
    for problem in problems.values():
        assert problem.primitives
        assert len(problem.notes) == 1
        assert all("finger" in n and "0.065" in n and "beyond" in n for n in problem.notes)


@pytest.mark.parametrize("name", SOME)
def test_paths_and_timed_curves_are_free_among_the_true_primitives(problems, name):
    problem = problems[name]
    bench = Workbench(problem)
    planned = bench.goal_set_rrt(0)
    assert planned.path is not None
    np.testing.assert_array_equal(planned.path[0], problem.start)
    np.testing.assert_array_equal(planned.path[-1], problem.q_goal)
    assert planned.edges >= len(planned.path) - 1

    shortened = bench.shorten(planned.path, 0)
    assert shortened.length == path_length(shortened.path) <= path_length(planned.path)
    assert shortened.trajectory is not None
    instants = np.linspace(0, shortened.trajectory.duration, 200)
    timed, velocity, _ = evaluate_trajectory(shortened.trajectory, instants)
    assert (np.abs(velocity) <= problem.arm.velocity * (1 + 1e-6)).all()

    world = TrueWorld(problem)
    for states in (dense(planned.path), dense(shortened.path), timed):
        for q in states:
            assert world.hits(q) == ""


def test_the_true_world_sees_what_stands_in_the_way(problems):
    """A straight motion that the edge test refuses does hit something, else it proves little."""
    problem = problems["bookshelf_small/0001"]
    world = TrueWorld(problem)
    straight = dense(np.array([problem.start, problem.q_goal]))
    assert any("meets" in world.hits(q) for q in straight)
    assert not Workbench(problem).edge_free(problem.start, problem.q_goal)


def test_shortening_keeps_up_with_ompl(problems):
    """One path; the whole comparison is `python -m benchmarks motion`."""
    bench = Workbench(problems["bookshelf_small/0013"])
    path = bench.goal_set_rrt(1).path
    ours, theirs = bench.shorten(path, 1), bench.simplify(path)
    np.testing.assert_array_equal(theirs.path[[0, -1]], path[[0, -1]])
    assert ours.length < 1.15 * theirs.length
    assert ours.length < 0.9 * path_length(path)


@pytest.mark.parametrize("name", ["bookshelf_small/0004", "table_pick/0012"])
def test_the_planner_of_ompl_over_the_search_finds_the_same_path(problems, name):
    bench = Workbench(problems[name])
    own, by_ompl = bench.goal_set_rrt(0), bench.goal_set_planner(0)
    np.testing.assert_array_equal(by_ompl.path, own.path)
    assert by_ompl.edges == own.edges


def test_stock_rrt_connect_solves_with_the_same_edge_test(problems):
    bench = Workbench(problems["table_pick/0012"])
    planned = bench.rrt_connect()
    assert planned.path is not None
    assert planned.edges > 0
    world = TrueWorld(bench.problem)
    assert all(world.hits(q) == "" for q in dense(planned.path))


def test_an_arm_beyond_its_limits_is_refused(problems, tmp_path):
    folder = DATA / "problems/table_pick"
    request = tmp_path / "request.yaml"
    text = (folder / "request0001.yaml").read_text()
    assert text.count("-2.356") == 1
    request.write_text(text.replace("-2.356", "-3.356"))
    robot = problems["table_pick/0001"].robot
    with pytest.raises(JointStateError, match=r"start.*panda_joint4"):
        read_problem("it", folder / "scene0001.yaml", request, robot, "panda_hand_tcp")


def test_other_files_are_refused(problems, tmp_path):
    robot = problems["table_pick/0001"].robot
    folder = DATA / "problems/table_pick"
    scene, request = folder / "scene0001.yaml", folder / "request0001.yaml"
    with pytest.raises(ParameterError, match="is not a scene and a request"):
        read_problem("it", request, scene, robot, "panda_hand_tcp")
    odd = tmp_path / "scene.yaml"
    odd.write_text(scene.read_text().replace("cylinder", "cone"))
    with pytest.raises(ParameterError, match="cone"):
        read_problem("it", odd, request, robot, "panda_hand_tcp")
    with pytest.raises(ParameterError, match="cannot be read"):
        read_problem("it", tmp_path / "none.yaml", request, robot, "panda_hand_tcp")
    with pytest.raises(ParameterError, match="must hold"):
        panda_problems(tmp_path)
