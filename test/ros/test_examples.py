"""Each example as its reader would run it, against the real node."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from helpers.fakes import COMPILED, Spinning
from helpers.published import pose_of
from helpers.system import OBJECT, running_node, wait
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState

import placement_planner_ros
from placement_planner_ros.client import PlacementClient, PlacementError
from placement_planner_ros.ros.inputs.resources import package_share
from placement_planner_ros.ros.tools.robot_check import main as check_robot
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.yumi import start_configuration

EXAMPLES = Path(__file__).parents[2] / "examples"
STALE = ("NO_CLOUD", "JOINTS_MISSING", "JOINTS_STALE", "NO_REGION", "NO_SOLUTION")
"""Codes of a node that has not heard yet of what an example publishes."""


@pytest.fixture(scope="module")
def node(ros_module, tmp_path_factory):
    """The node where a package with the objective of `own_objective.py` is installed."""
    folder = tmp_path_factory.mktemp("installed")
    info = folder / "own_objective-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own_objective\nVersion: 1.0\n")
    module = (EXAMPLES / "own_objective.py").read_text()
    (folder / "own_objective.py").write_text(module)
    table, point = re.search(
        r"    (\[project.entry-points.*\])\n    (near_point.*)\n", module
    ).groups()
    group = re.search(r'"(.*)"', table).group(1)
    (info / "entry_points.txt").write_text(f"[{group}]\n{point.replace(chr(34), '')}\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")]))
        yield from running_node(tmp_path_factory.mktemp("node") / "node.log")


@pytest.fixture(scope="module")
def planner(node):
    with PlacementClient() as made:
        wait(lambda: made.status is not None and made.status.values["warm"] == "true", COMPILED)
        yield made


@pytest.fixture
def resting(planner):
    """The bundled robot, at rest with the box in hand."""
    node = Node("resting_robot")
    joint_states = node.create_publisher(JointState, "joint_states", 10)
    start = start_configuration(OBJECT)
    message = JointState(name=list(start), position=[float(q) for q in start.values()])
    node.create_timer(0.05, lambda: joint_states.publish(message))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spinning = Spinning(executor)
    yield
    spinning.end()
    node.destroy_node()


@pytest.fixture
def example(tmp_path):
    """Starts examples; what they have said, once they have ended or were interrupted."""
    started = []

    def start(name, *arguments):
        root = str(Path(placement_planner_ros.__file__).parent.parent)
        path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
        started.append(
            subprocess.Popen(
                [sys.executable, EXAMPLES / name, *arguments],
                cwd=tmp_path,
                env={**os.environ, "PYTHONPATH": path},
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
        )
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()


def interrupted(process):
    """What a program that goes on for ever has said; it ends as it should."""
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=600.0)
    assert process.returncode == 0, said
    assert "Traceback" not in said
    return said


def placed(planner, volume, **parameters):
    """A placement in that volume, once clouds show something there."""
    found = []

    def solved():
        given = {"target_volume": volume, "seed": 1, **parameters}
        try:
            found.append(planner.place(given, 10.0, until=lambda solution: True))
        except PlacementError as error:
            if error.code not in STALE:
                raise
        return found

    wait(solved)
    return found[0]


def lowest(solution):
    """z of the lowest point of the object where it was placed, m."""
    T = pose_of(solution.pose)
    return (object_by_name(OBJECT).vertices @ T.rotation.T + T.translation)[:, 2].min()


def test_an_executive_puts_down_three_boxes(planner, example):
    process = example("executive.py")
    said, _ = process.communicate(timeout=600.0)
    assert process.returncode == 0, said
    boxes = re.findall(r"^box (\d): solution \d+ .* to (\S+) (\S+) (\S+) in yumi_body", said, re.M)
    assert [number for number, *_ in boxes] == ["1", "2", "3"], said
    wait(lambda: len(planner.status.values["placed"].split()) == 3)
    places = np.array([[float(each) for each in place] for _, *place in boxes])
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    assert apart[~np.eye(3, dtype=bool)].min() > 0.02, "they would be in each other"
    planner.clear_environment()


def test_a_cloud_file_is_what_the_camera_sees(planner, example, resting, tmp_path):
    for file, top in (("board.ply", 0.1), ("board.npy", 0.16)):
        board = trimesh.creation.box(bounds=[[0.3, -0.3, top - 0.02], [0.6, 0.3, top]])
        points, _ = trimesh.remesh.subdivide_to_size(board.vertices, board.faces, 0.005, 20)
        if file.endswith(".npy"):
            np.save(tmp_path / file, points)
        else:
            trimesh.PointCloud(points).export(tmp_path / file)
        camera = example("camera.py", file, "--frame", "yumi_body")
        solution = placed(planner, [0.3, -0.3, top - 0.03, 0.6, 0.3, top + 0.03])
        assert lowest(solution) == pytest.approx(top, abs=0.004)
        assert f"{len(points)} points of {file}" in interrupted(camera)


def test_known_meshes_are_the_scene(planner, example, resting, tmp_path):
    publisher = example("known_scene.py")
    solution = placed(planner, [0.2, -0.35, -0.05, 0.6, 0.35, 0.03])
    assert lowest(solution) == pytest.approx(0.0, abs=0.004)
    assert "3 meshes" in interrupted(publisher)
    trimesh.creation.box(bounds=[[0.2, -0.4, 0.0], [0.6, 0.4, 0.2]]).export(tmp_path / "high.stl")
    publisher = example("known_scene.py", "high.stl")
    solution = placed(planner, [0.2, -0.35, 0.15, 0.6, 0.35, 0.25])
    assert lowest(solution) == pytest.approx(0.2, abs=0.004)
    assert "1 meshes" in interrupted(publisher)


def test_an_objective_of_ones_own_is_used_by_library_and_node(planner, example, resting):
    process = example("own_objective.py")
    said, _ = process.communicate(timeout=600.0)
    assert process.returncode == 0, said
    found = re.findall(r"^at (\S+) (\S+) \S+: objective (\S+)$", said, re.M)
    objectives = [float(objective) for *_, objective in found]
    assert objectives
    assert objectives == sorted(set(objectives))
    for x, y, objective in found:
        away = np.hypot(float(x) - 0.55, float(y) + 0.05)
        assert -away - 0.05 * np.pi / 2 - 0.001 <= float(objective) <= -away + 0.001
    publisher = example("known_scene.py")
    on_the_table = [0.2, -0.35, -0.05, 0.6, 0.35, 0.03]
    solution = placed(planner, on_the_table, objective="near_point")
    x, y = solution.pose.pose.position.x, solution.pose.pose.position.y
    away = np.hypot(x - 0.55, y + 0.05)
    assert -away - 0.05 * np.pi / 2 - 0.001 <= solution.objective <= -away + 0.001
    interrupted(publisher)


def test_a_robot_of_ones_own_could_plan(capsys):
    try:
        package_share("example-robot-data")
    except FileNotFoundError:
        pytest.skip("example-robot-data is missing: pip install '.[robots]'")
    assert check_robot(["--params-file", str(EXAMPLES / "own_robot.yaml")]) == 0
    assert "nothing is wrong" in capsys.readouterr().out


def test_every_example_is_run_here():
    here = Path(__file__).read_text()
    library = (Path(__file__).parents[1] / "test_library.py").read_text()
    scene = (Path(__file__).parent / "test_planning_scene.py").read_text()
    for file in EXAMPLES.iterdir():
        assert f'"{file.name}"' in here + library + scene, file.name
