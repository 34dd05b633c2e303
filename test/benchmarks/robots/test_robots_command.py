"""`python -m benchmarks robots` on a robot written here, and the table it writes."""

import json

import numpy as np
import pytest

from benchmarks.__main__ import main
from benchmarks.robots.command import RAW_FILE, robots_table
from benchmarks.robots.subject import read_measured_robot
from benchmarks.robots.things import CLOUDS, OBJECTS, object_of, observe, table_of
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.share import share_path

FILE = """
/**:
  ros__parameters:
    robot_description: package://placement_planner_ros/urdf/yumi.urdf
    robot_description_semantic: package://placement_planner_ros/urdf/yumi.srdf
    arms: [left]
    left: {tip_frame: gripper_l_base, grasps: [0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0]}
    target_volume: [0.2, -0.3, -0.1, 0.6, 0.3, 0.2]
    object:
      vertices: [0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.1]
      triangles: [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]
placement_scene:
  ros__parameters:
    start: {yumi_joint_2_l: -1.0, yumi_joint_2_r: -1.0}
"""


@pytest.fixture
def given(tmp_path):
    """A parameter file, and the folder that holds the package it names."""
    packages = tmp_path / "packages"
    packages.mkdir()
    (packages / "placement_planner_ros").symlink_to(share_path("urdf").parent)
    file = tmp_path / "two_arms.yaml"
    file.write_text(FILE)
    return file, packages


def test_what_a_file_gives_is_read(given):
    file, packages = given
    subject = read_measured_robot(file, [packages])
    assert (subject.name, subject.arms[0].tip_frame) == ("two_arms", "gripper_l_base")
    assert subject.q_start[subject.robot.index("yumi_joint_2_l")] == -1.0
    assert len(subject.vertices) == 4
    vertices, triangles = object_of(subject, OBJECTS[1])
    assert (len(vertices), len(triangles)) == (16, 24)
    file.write_text(FILE.replace("package://placement_planner_ros/urdf/yumi.urdf", "package://a/b"))
    with pytest.raises(ParameterError, match="robot_description"):
        read_measured_robot(file, [packages])


def test_rows_are_measured_and_written(given, tmp_path, capsys):
    file, packages = given
    page, output = tmp_path / "page.md", tmp_path / "out"
    page.write_text("before\n<!-- figures -->\n<!-- end of figures -->\nafter\n")
    options = ["--output", str(output), "--page", str(page), "--rows", "edges"]
    options += ["--packages", str(packages), "--beside", str(file)]
    assert main(["robots", str(file), *options]) == 0
    assert "| two_arms | edge of 0.5 rad, certified |" in page.read_text()
    assert page.read_text().startswith("before\n")
    assert page.read_text().endswith("after\n")
    (line,) = (output / RAW_FILE).read_text().splitlines()
    assert json.loads(line)["robot"] == "two_arms"
    file.write_text("nothing")
    assert main(["robots", str(file), *options]) == 1
    assert "FAILED" in capsys.readouterr().out


def entry(row, **values):
    return {"robot": "r", "row": row, **values}


def test_the_table_says_what_is_met():
    first = {"object": OBJECTS[0], "cloud": CLOUDS[0], "failure": "", "refused": []}
    entries = [
        entry("first", seed=0, seconds=0.5, solutions=3, **first),
        entry("first", seed=1, seconds=10.0, solutions=0, **first),
        entry("node", made=70.0, made_processor=61.0, cached=None, cached_processor=None),
        entry(
            "agreement",
            configurations=1000,
            called_free=500,
            wrongly_free=1,
            clear=400,
            clear_called_free=400,
        ),
    ]
    table = robots_table(entries)
    for line in (
        "| r | first placement, slowest | 10.00 s | <= 5 s | **no** |",
        "| r | solutions that the checker refuses | 0 faults in 3 solutions | 0 | yes |",
        "| r | node start to warm, covers cached | never | <= 5 s | **no** |",
        "| r | nearer than the margin, called free | 1 of 500 called free, of 1,000 configurations "
        "| 0 | **no** |",
        "| r | farther than margin and 2 mm, called free | 100.000 % of 400 | >= 99.9 % | yes |",
    ):
        assert line in table


@pytest.mark.parametrize("cloud", CLOUDS)
def test_clouds_show_the_table_and_what_stands_on_it(given, cloud):
    subject = read_measured_robot(given[0], [given[1]])
    scene = table_of(subject.volume, np.random.default_rng(0))
    seen = observe(scene, cloud, np.random.default_rng(0))
    points = seen.points
    assert len(seen.sights) == (cloud == CLOUDS[1])
    assert len(scene.parts) == 7
    inside = subject.volume.contains(points)
    assert inside.sum() > 1000
    assert points[inside, 2].max() > subject.volume.lower[2] + 0.08
