"""What is remembered of a run, and the words and charts made of it."""

import re

import pytest
from helpers.view_node import solution, status

from placement_planner_ros.client import PlacementError
from placement_planner_ros.view import words
from placement_planner_ros.view.record import RunRecord

charts = pytest.importorskip("placement_planner_ros.view.charts", reason="viser is not installed")


def record_of(*solutions, **values):
    """A record that has heard of these solutions of run 7."""
    known = {(s.run, s.number): s for s in solutions}
    record = RunRecord()
    record.take_status(
        status(solutions=len(solutions), **values), lambda r, n: known.get((r, n)), {"j": 0.5}
    )
    return record


@pytest.mark.parametrize("run", [0, 6, 8])
def test_another_run_begins_anew_whatever_its_number(run):
    record = record_of(solution())
    record.take_status(status(run=run), lambda r, n: None, {})
    assert record.run == run
    assert record.best is None


def test_the_bars_are_as_long_as_their_numbers_are_large():
    html = charts.rejection_bars({"unstable": 900, "no_ik": 450, "no_retreat": 0}, 2000)
    widths = [float(w) for w in re.findall(r"width:([\d.]+)%\"></span>", html)]
    assert widths == [100.0, 50.0]
    assert words.CONSTRAINTS["unstable"] in html
    assert words.CONSTRAINTS["no_retreat"] not in html
    assert "900" in html


def test_every_constraint_of_the_planner_has_words():
    from placement_planner_ros.core.types import Verdict

    named = {verdict.name.lower() for verdict in Verdict if verdict is not Verdict.FEASIBLE}
    assert set(words.CONSTRAINTS) == named


def test_the_curve_rises_step_by_step():
    times, best = charts.curve_data([(1.0, 0.1), (2.0, 0.3)], 4.0)
    assert times.tolist() == [1.0, 2.0, 2.0, 4.0]
    assert best.tolist() == [0.1, 0.1, 0.3, 0.3]


def test_what_comes_from_outside_is_no_html():
    record = record_of(solution(arm="<script>"), state="<b>")
    shown = words.placement_html(record.best.solution, 1, "<i>", "<u>", False)
    for html in (
        shown,
        words.heading_html(record, ""),
        words.heading_html(record, "<a>"),
        words.note_html("<p>"),
    ):
        assert not re.search(r"<(script|b>&|i>|u>|a>|p>)", html.replace("<b>", "", 9))
    assert "&lt;script&gt;" in shown
    assert "&lt;i&gt;" in shown


def test_only_the_best_is_said_to_be_ready():
    first, best = solution(1), solution(2)
    assert "can be carried out" in words.placement_html(best, 2, "", "o", False)
    assert "can be carried out" not in words.placement_html(first, 2, "", "o", False)
    said = words.placement_html(best, 2, "the robot has left", "o", False)
    assert "the robot has left" in said
    assert "It can be" not in said


def test_a_refusal_is_said_in_words_with_its_code():
    said = words.refusal_words(PlacementError("ALREADY_RUNNING", "state searching"))
    assert said == "A run is going on; stop it first. state searching (ALREADY_RUNNING)"
    said = words.refusal_words(PlacementError("BAD_VOLUME", "BAD_VOLUME: target_volume: too thin"))
    assert said == "target_volume: too thin (BAD_VOLUME)"


def test_every_fault_of_a_refusal_has_its_own_line_and_code():
    error = PlacementError("NO_CLOUD", "NO_CLOUD: none has come\nJOINTS_MISSING: give j, too")
    said = words.refusal_words(error)
    assert said.split("\n") == ["none has come (NO_CLOUD)", "give j, too (JOINTS_MISSING)"]
    assert "(NO_CLOUD)<br>give j" in words.note_html(said)


def test_a_search_that_ends_with_nothing_is_not_told_as_if_there_was_a_best():
    empty = words.heading_html(record_of(state="exhausted"), "")
    assert "nothing is left to try" in empty
    assert "better" not in empty
    assert "yet" not in empty
    assert "nothing better is left" in words.heading_html(
        record_of(solution(), state="exhausted"), ""
    )
    assert "found yet" in words.heading_html(record_of(state="searching"), "")


def test_that_the_object_stands_is_not_said_of_one_placement_as_the_node_names_the_run_only():
    for number in (1, 2):
        said = words.placement_html(solution(number), 2, "", "o", True)
        assert "put down already" in said
        assert "carried out" not in said
        assert "there now" not in said


def test_what_it_leans_on_is_said():
    leaning = solution(contact="lean", leans_on="the wall at <x>")
    assert "leans on the wall at &lt;x&gt;" in words.placement_html(leaning, 1, "", "o", False)
