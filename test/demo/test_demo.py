"""The demonstration: what it counts, what it leaves, and that it says why wherever it ends."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from PIL import Image

import placement_planner_ros
from placement_planner_ros.client import PlacementError
from placement_planner_ros.demo import command, processes, search
from placement_planner_ros.demo.processes import DemoError, node_running
from placement_planner_ros.demo.results import require_folder
from placement_planner_ros.demo.setting import bundled, of_file
from placement_planner_ros.progress import ProgressLine
from placement_planner_ros.scenes.yumi import START_CONFIGURATION

RUN = 17


def alive():
    """A node that has not died."""


class Planner:
    """A client whose run finds something after so many looks."""

    def __init__(self, clock, first_after=None, ends_after=None, refusal=None, count=1):
        self.count = count
        self.clock, self.first_after, self.ends_after = clock, first_after, ends_after
        self.refusal = refusal
        self.stopped_at = None
        self.began = None

    def start(self, parameters, patience):
        if self.refusal is not None:
            raise self.refusal
        self.began = self.clock.now
        return RUN

    @property
    def status(self):
        ended = self.ends_after is not None and self.clock.now - self.began >= self.ends_after
        return SimpleNamespace(run=RUN, ended=ended, values={"samples": "1200"})

    def improvement(self, run, number=None):
        if self.first_after is None or self.clock.now - self.began < self.first_after:
            return None
        number = number or self.count
        return SimpleNamespace(
            number=number,
            search_time=self.first_after + 0.01 * (number - 1),
            arm="left",
            objective=0.25,
            words="at 0 0 0",
        )

    def stop(self, run):
        self.stopped_at = self.clock.now - self.began
        found = self.improvement(run)
        if found is None:
            raise PlacementError("NO_SOLUTION", "in 12 samples no placement was found", run)
        return found


class Clock:
    """Time that passes only while somebody sleeps."""

    def __init__(self):
        self.now = 1000.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(search, "time", made)
    return made


def test_seconds_count_from_the_first_placement_on(clock, capsys):
    planner = Planner(clock, first_after=50.0)
    found = search.search(planner, 10.0, alive, ProgressLine())
    assert planner.stopped_at == pytest.approx(60.0, abs=1.0)
    assert [solution.number for solution in found] == [1]
    said = capsys.readouterr().out
    assert "the first placement came 50.00 s after the start" in said
    assert "objective 0.2500" in said


def test_nothing_found_says_how_long_and_why(clock):
    planner = Planner(clock)
    with pytest.raises(
        DemoError, match=r"(?s)no placement was found in 12\d s.*in 12 samples.*try"
    ):
        search.search(planner, 10.0, alive, ProgressLine())
    assert planner.stopped_at == pytest.approx(search.FIRST_WITHIN_S, abs=1.0)


def test_a_refused_start_says_the_nodes_words(clock):
    refusal = PlacementError("BAD_VOLUME", "target_volume: lower above upper")
    with pytest.raises(DemoError, match=r"(?s)refused.*BAD_VOLUME: target_volume: lower.*troubles"):
        search.search(Planner(clock, refusal=refusal), 10.0, alive, ProgressLine())


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
    folder = tmp_path / "file" / "folder"
    with pytest.raises(DemoError, match=r"(?s)nothing can be written.*--output"):
        require_folder(folder)
    assert command.main(["--output", str(folder)]) == 1
    assert "what to try" in capsys.readouterr().err


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
    setting = of_file(own_box(tmp_path), "table")
    assert setting.scene.name == "table"
    assert setting.parameters == bundled("table", "wine_glass").parameters
    np.testing.assert_allclose(np.ptp(setting.vertices, axis=0), (0.03, 0.05, 0.1))
    usual = setting.robot.configuration(START_CONFIGURATION)
    np.testing.assert_allclose(setting.q_start, usual)


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
    assert "the first placement came" in out
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
