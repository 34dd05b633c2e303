"""Robots as their makers ship them, from PyPI's example-robot-data, as `config/robots` has them."""

import xml.etree.ElementTree as ET
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.library import plan
from placement_planner_ros.ros.inputs.resources import package_share
from placement_planner_ros.ros.tools.findings import Findings
from placement_planner_ros.ros.tools.given import read_given, start_in
from placement_planner_ros.ros.tools.robot_check import check_grasps, check_search, read_snapshot
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.scenes import table_of_things

CONFIG = Path(__file__).parents[3] / "config" / "robots"
ALL = sorted(CONFIG.glob("*.yaml"))
LIMITS = ("lower", "upper")


def subject_of(name):
    """A robot of `config/robots`, which must be in order."""
    try:
        package_share("example-robot-data")
    except FileNotFoundError:
        pytest.skip("example-robot-data is missing: pip install '.[robots]'")
    findings, file = Findings(), CONFIG / f"{name}.yaml"
    given = read_given(file, {}, findings)
    subject = read_snapshot(given, None, findings, start_in(file))
    assert findings.faults == []
    check_grasps(subject, findings)
    assert findings.remarks == []
    return subject


@pytest.mark.parametrize("file", ALL, ids=lambda file: file.stem)
def test_each_file_is_short_and_right_as_far_as_it_goes(file):
    assert 10 <= len(file.read_text().splitlines()) <= 25
    findings = Findings()
    given = read_given(file, {}, findings)
    assert findings.faults == []
    assert all(given.parameters[f"{arm}.grasps"] for arm in given.parameters["arms"])
    assert start_in(file)


def test_a_robot_reaches_what_its_file_asks_for():
    findings = Findings()
    check_search(subject_of("ur5"), findings)
    assert findings.faults == []


def placements_among_things(subject):
    """Placements of the first arm, one better than the other."""
    volume = subject.parameters.volume
    points = complete_cloud(table_of_things(volume))
    environment = Environment.from_points(points, volume, bounds=(points.min(0), volume.upper))
    given = subject.arms[0], subject.q_start, subject.body, volume, environment
    return plan(subject.robot, *given, time_limit=60.0, seed=0)


def test_a_pr2_stays_within_the_limits_that_moveit_keeps():
    subject = subject_of("pr2")
    file = package_share("example-robot-data") / "robots/pr2_description/urdf/pr2.urdf"
    soft = {}
    for joint in ET.parse(file).getroot().findall("joint"):
        safety = joint.find("safety_controller")
        if safety is not None and "soft_lower_limit" in safety.attrib:
            soft[joint.get("name")] = [float(safety.get(f"soft_{e}_limit")) for e in LIMITS]
    ways = [found.trajectory for found in islice(placements_among_things(subject), 3)]
    assert len(ways) == 3
    bounded = [joint for joint in subject.arms[0].joints if joint in soft]
    assert len(bounded) >= 4
    for joint in bounded:
        column = subject.arms[0].joints.index(joint)
        positions = np.concatenate([way.positions[:, column] for way in ways])
        assert soft[joint][0] <= positions.min() <= positions.max() <= soft[joint][1], joint


def test_a_panda_places_its_object_among_things():
    subject = subject_of("panda")
    volume, arm, q = subject.parameters.volume, subject.arms[0], subject.q_start
    found = next(placements_among_things(subject))
    T = found.T_world_object
    lowest = (subject.body.vertices @ T.rotation.T + T.translation)[:, 2].min()
    assert lowest >= volume.lower[2] + 0.03 - 0.004
    np.testing.assert_allclose(found.trajectory.positions[0], q[arm.q_index], atol=1e-6)
