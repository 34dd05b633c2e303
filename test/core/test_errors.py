"""What errors say of values, however many there are."""

import pytest

from placement_planner_ros.core.errors import PlacementPlannerError, RobotError, listed, sayable

NAMES = [f"link_{i}" for i in range(300)]


def test_of_many_things_the_first_are_named_and_the_others_counted():
    assert listed(["a", "b"]) == "a, b"
    assert listed([]) == ""
    assert listed(NAMES[:12]).endswith("link_10, link_11")
    assert listed(NAMES[:13]).endswith("link_11 and 1 more")
    assert listed(NAMES, "; ", 2) == "link_0; link_1 and 298 more"


@pytest.mark.parametrize("many", [NAMES, tuple(NAMES), dict.fromkeys(NAMES, 0.5)])
def test_a_value_of_many_is_cut_and_kept_whole(many):
    error = RobotError("robot_description", many, "say less")
    assert "link_0'" in str(error)
    assert "and 288 more" in str(error)
    assert str(error).endswith(": say less")
    assert len(str(error)) < 500
    assert len(error.value) == 300


def test_a_long_word_is_cut_too():
    assert len(str(PlacementPlannerError("x" * 5000, "y" * 5000, "z"))) < 2100
    assert len(str(PlacementPlannerError("x", "y", "z" * 1_000_000))) < 1100


def test_words_can_be_sent_whatever_is_in_them():
    assert sayable("wine glass: 5 µm, 杯") == "wine glass: 5 µm, 杯"
    assert sayable("caf\udce9 \0\n").encode() == b"caf? ?\n"
