"""What is remembered of a run, and the words and charts made of it."""

import re

import pytest
from helpers.view_node import solution, status

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.description import read_urdf
from placement_planner_ros.view import words
from placement_planner_ros.view.record import RunRecord

charts = pytest.importorskip("placement_planner_ros.view.charts", reason="viser is not installed")


def record_of(best=None, **values):
    """A record that has heard of this solution of run 7."""
    record = RunRecord()
    record.take_status(status(solutions=int(best is not None), **values), lambda run: best, {})
    return record


@pytest.mark.parametrize("run", [0, 6, 8])
def test_another_run_begins_anew_whatever_its_number(run):
    record = record_of(solution())
    record.take_status(status(run=run), lambda run: None, {})
    assert record.run == run
    assert record.best is None


def test_the_bars_are_as_long_as_their_numbers_are_large():
    html = charts.rejection_bars({"unstable": 900, "no_ik": 450, "no_retreat": 0}, 2000)
    widths = [float(w) for w in re.findall(r"width:([\d.]+)%\"></span>", html)]
    assert widths == [100.0, 50.0]
    assert "unstable" in html
    assert "no retreat" not in html
    assert "900" in html


def test_what_comes_from_outside_is_no_html():
    record = record_of(solution(arm="<script>"), state="<b>")
    shown = words.placement_html(record.best.solution, "<i>", "<u>", False)
    for html in (
        shown,
        words.heading_html(record, ""),
        words.heading_html(record, "<a>"),
        words.note_html("<p>"),
    ):
        assert not re.search(r"<(script|b>&|i>|u>|a>|p>)", html.replace("<b>", "", 9))
    assert "&lt;script&gt;" in shown
    assert "&lt;i&gt;" in shown


def test_what_cannot_be_carried_out_is_not_said_to_be_ready():
    assert "can be carried out" in words.placement_html(solution(), "", "o", False)
    said = words.placement_html(solution(), "the robot has left", "o", False)
    assert "the robot has left" in said
    assert "It can be" not in said


def test_what_is_wrong_is_named_as_the_nodes_parameters_are():
    with pytest.raises(RobotError) as refused:
        read_urdf("<robot/>")
    assert "`urdf`" in str(refused.value)
    assert ">robot_description = " in words.note_html(str(refused.value))
    assert "none has come<br>give j" in words.note_html("none has come\ngive j, too")
