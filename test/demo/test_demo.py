"""The demonstration: what it counts, what it leaves, and that it says why wherever it ends."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from PIL import Image

import placement_planner_ros
from placement_planner_ros.client import PlacementError, Validity
from placement_planner_ros.demo import command, processes
from placement_planner_ros.demo.processes import DemoError, node_running
from placement_planner_ros.demo.search import Asking
from placement_planner_ros.demo.setting import bundled, read_setting
from placement_planner_ros.progress import ProgressLine
from placement_planner_ros.scenes.objects import OBJECT_NAMES, object_by_name
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, start_configuration

VALID = Validity()


class Node:
    """A client whose run finds some solutions, a publisher and a node, which remember what they
    hear."""

    def __init__(self, found=1, refusal=None, validity=VALID, late=False):
        self.found, self.refusal, self.validity_of = found, refusal, validity
        self.late = late
        self.told, self.shown, self.confirmed = [], [], []

    def place(self, parameters, deadline, until):
        if self.refusal is not None:
            raise self.refusal
        self.told.append(parameters)
        if self.late and len(self.told) == 1:
            raise PlacementError("NO_SOLUTION", "in 12 samples no placement was found", 17)
        for number in range(1, self.found + 1):
            solution = SimpleNamespace(
                number=number, search_time=0.5, arm="left", objective=0.25, words="at 0 0 0"
            )
            if until(solution):
                break
        return solution

    def validity(self, solution):
        return self.validity_of

    def confirm_placed(self, solution):
        self.confirmed.append(solution)

    def show(self, positions):
        self.shown.append(positions)

    def search(self, confirm=False):
        return Asking(self, lambda: None, ProgressLine()).search({}, 10.0, confirm)


def test_each_solution_is_told_and_the_best_is_last(capsys):
    node = Node(found=3)
    assert [solution.number for solution in node.search()] == [1, 2, 3]
    assert capsys.readouterr().out.count("objective 0.2500") == 3
    assert node.confirmed == []


def test_where_nothing_is_found_in_time_the_first_will_do():
    node = Node(found=3, late=True)
    assert [solution.number for solution in node.search()] == [1]


@pytest.mark.parametrize(
    ("code", "remedy"), [("BAD_VOLUME", "troubleshooting"), ("NO_NODE", "busy")]
)
def test_why_there_is_no_placement_is_in_the_nodes_words(code, remedy):
    node = Node(refusal=PlacementError(code, "target_volume: lower above upper"))
    with pytest.raises(DemoError, match=rf"(?s){code}: target_volume: lower.*{remedy}"):
        node.search()


def test_on_a_tour_the_node_knows_what_is_held_and_that_it_stands():
    node = Node()
    asking = Asking(node, lambda: None, ProgressLine())
    options = SimpleNamespace(tour=True, seconds=1.0)
    settings = [bundled("table", name) for name in OBJECT_NAMES]
    for setting in settings:
        command.put_down(asking, node, setting, options)
    for name, told in zip(OBJECT_NAMES, node.told, strict=True):
        held = object_by_name(name)
        near = {"rtol": 0.0, "atol": 1e-8}
        np.testing.assert_allclose(told["object.vertices"], held.vertices.ravel(), **near)
        np.testing.assert_array_equal(told["object.triangles"], held.triangles.ravel())
        np.testing.assert_allclose(told["object.center_of_mass"], held.center_of_mass, **near)
        for arm, grasps in held.grasps.items():
            poses = np.reshape(told[f"{arm}.grasps"], (-1, 7))
            for given, T in zip(poses, grasps, strict=True):
                np.testing.assert_allclose(pin.XYZQUATToSE3(given), T, **near)
    for name, shown in zip(OBJECT_NAMES, node.shown, strict=True):
        assert shown == pytest.approx(start_configuration(name))
    assert len(node.confirmed) == len(OBJECT_NAMES)


def test_a_placement_that_does_not_hold_any_more_is_not_confirmed():
    node = Node(validity=Validity("something stands there now"))
    with pytest.raises(DemoError, match="something stands there now"):
        node.search(confirm=True)
    assert node.confirmed == []


@pytest.mark.parametrize(
    "given",
    [
        ["--tour", "--params-file", "x"],
        ["--tour", "--object", "book"],
        ["--object", "book", "book"],
    ],
)
def test_what_does_not_go_together_is_refused(given, capsys):
    with pytest.raises(SystemExit):
        command.main(given)
    assert "--tour" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("print('disk gone'); raise SystemExit(3)", r"(?s)with code 3.*disk gone.*node\.log"),
        ("import os; print('x', flush=True); os.kill(os.getpid(), 9)", r"(?s)code -9.*memory"),
        ("import os; os.kill(os.getpid(), 11)", r"(?s)code -11.*empty.*troubleshooting"),
    ],
)
def test_a_node_that_died_is_named_with_its_last_words(monkeypatch, tmp_path, script, words):
    monkeypatch.setattr(processes, "_NODE", [sys.executable, "-c", script])
    with pytest.raises(DemoError, match=words):
        watched_until_it_ends(tmp_path / "node.log")


def watched_until_it_ends(log):
    with node_running("/x", [], log) as require_alive:
        while True:
            require_alive()
            time.sleep(0.05)


def test_a_folder_that_cannot_be_written_is_named_before_anything_else(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert command.main(["--output", str(tmp_path / "file" / "folder")]) == 1
    said = capsys.readouterr()
    assert "nothing can be written" in said.err
    assert "--output" in said.err
    assert said.out == ""


def own_box(tmp_path, more=""):
    file = tmp_path / "my_box.yaml"
    trimesh.creation.box((0.03, 0.05, 0.1)).export(tmp_path / "my_box.stl")
    grasps = "{grasps: [0.0, 0.0, 0.16, 0.0, 0.0, 0.0, 1.0]}"
    file.write_text(
        f"/**:\n  ros__parameters:\n    object: {{mesh: {tmp_path}/my_box.stl}}\n"
        f"    left: {grasps}\n    right: {grasps}\n{more}"
    )
    return file


def test_an_object_of_ones_own_goes_to_the_bundled_scene(tmp_path):
    setting = read_setting(own_box(tmp_path), "table")
    assert setting.scene.name == "table"
    assert setting.parameters == bundled("table", "wine_glass").parameters
    np.testing.assert_allclose(np.ptp(setting.corners, axis=(0, 1)), (0.03, 0.05, 0.1))
    assert {name: setting.positions[name] for name in START_CONFIGURATION} == START_CONFIGURATION


# --- the real one


def demo(tmp_path, *arguments, **environment):
    root = str(Path(placement_planner_ros.__file__).parent.parent)
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
    return subprocess.Popen(
        [sys.executable, "-m", "placement_planner_ros", "placement_demo", *arguments],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1", **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_the_demonstration_leaves_pictures_and_says_which(tmp_path):
    process = demo(tmp_path, "--seconds", "1", "--seed", "1")
    out, err = process.communicate(timeout=900.0)
    assert process.returncode == 0, out + err
    assert "solution   1" in out
    assert "edge_margin" in out
    for name in ("placement.png", "motion.gif", "objective.png", "node.log"):
        assert f"demo_output/{name}" in out
        assert (tmp_path / "demo_output" / name).stat().st_size > 500
    assert Image.open(tmp_path / "demo_output" / "motion.gif").n_frames > 20


def children(process):
    listed = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text()
    return [int(pid) for pid in listed.split()]


def once_a_node_runs(process):
    for line in process.stdout:
        if "the node gets ready" in line:
            return children(process)
    raise AssertionError(process.stderr.read())


def gone(pid):
    for _ in range(1200):
        if not Path(f"/proc/{pid}").exists():
            return True
        time.sleep(0.1)
    return False


def test_interrupted_it_says_so_and_leaves_no_node(tmp_path):
    process = demo(tmp_path)
    nodes = once_a_node_runs(process)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=600.0)
    assert process.returncode == 130, err
    assert "interrupted" in err
    assert "Traceback" not in err
    assert nodes
    assert all(gone(pid) for pid in nodes)
