"""Robots as their makers ship them, from PyPI's example-robot-data, as `config/robots` has them."""

from pathlib import Path

import numpy as np
import pytest

from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.library import plan
from placement_planner_ros.ros.inputs.resources import package_share
from placement_planner_ros.ros.tools.robot_check.findings import Findings
from placement_planner_ros.ros.tools.robot_check.given import read_given, start_in
from placement_planner_ros.ros.tools.robot_check.grasps import check_grasps
from placement_planner_ros.ros.tools.robot_check.reach import reached_share
from placement_planner_ros.ros.tools.robot_check.subject import read_subject
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.table_of_things import table_of_things

CONFIG = Path(__file__).parents[3] / "config" / "robots"
ALL = sorted(CONFIG.glob("*.yaml"))


def subject_of(name):
    """A robot of `config/robots`, which must be in order."""
    try:
        package_share("example-robot-data")
    except FileNotFoundError:
        pytest.skip("example-robot-data is missing: pip install '.[robots]'")
    findings, file = Findings(), CONFIG / f"{name}.yaml"
    given = read_given(file, {}, findings)
    subject = read_subject(given, None, findings, start_in(file))
    assert findings.faults == []
    assert check_grasps(subject, findings), findings.faults
    assert findings.faults == []
    return subject


@pytest.mark.parametrize("file", ALL, ids=lambda file: file.stem)
def test_each_file_is_short_and_right_as_far_as_it_goes(file):
    assert 10 <= len(file.read_text().splitlines()) <= 25
    findings = Findings()
    given = read_given(file, {}, findings)
    assert findings.faults == []
    assert all(given.parameters[f"{arm}.grasps"] for arm in given.parameters["arms"])
    assert start_in(file)


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_a_robot_reaches_what_its_file_asks_for(name):
    subject = subject_of(name)
    assert reached_share(subject, subject.arms[0], 0, subject.parameters.volume) > 0.5


def test_a_panda_places_its_object_among_things():
    subject = subject_of("panda")
    volume = subject.parameters.volume
    points = complete_cloud(table_of_things(volume))
    environment = Environment.from_points(points, volume, bounds=(points.min(0), volume.upper))
    arm, q, robot = subject.arms[0], subject.q, subject.robot
    found = next(plan(robot, arm, q, subject.body, volume, environment, time_limit=60.0, seed=0))
    T = found.T_world_object
    lowest = (subject.body.vertices @ T.rotation.T + T.translation)[:, 2].min()
    assert lowest >= volume.lower[2] + 0.03 - 0.004
    np.testing.assert_allclose(found.trajectory.positions[0], q[arm.q_index], atol=1e-6)
