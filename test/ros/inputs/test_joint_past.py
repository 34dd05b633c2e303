import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from placement_planner_ros.ros.inputs.joint_past import HISTORY_S, SPACING_S, JointPast, Sample

STAMPS = st.floats(-1e9, 1e10)
POSITIONS = st.floats(-1e300, 1e300)


REST_SPEED = 0.02


class Past(JointPast):
    """Asked with the usual speed of rest."""

    def at(self, stamp, rest_speed=REST_SPEED):
        return super().at(stamp, rest_speed)

    def moves(self, stamp, rest_speed=REST_SPEED):
        return super().moves(stamp, rest_speed)


def past(position, times):
    made = Past()
    for t in times:
        made.add(Sample(float(t), float(position(t))))
    return made


TIMES = np.arange(100.0, 101.0, 0.01)


def test_a_moving_joint_is_where_it_was_then():
    made = past(lambda t: 0.5 * (t - 100.0), TIMES)
    for stamp in (100.0, 100.123, 100.5, 100.99):
        assert made.at(stamp) == pytest.approx(0.5 * (stamp - 100.0), abs=1e-9)


def test_what_is_not_known_of_a_joint_is_taken_from_now_only_if_it_rested():
    resting, moving = past(lambda t: 0.3, TIMES), past(lambda t: 0.3 + (t - 100.0) / 10, TIMES)
    stopped = past(lambda t: 0.3 + min(t - 100.0, 0.1), TIMES)
    for stamp in (None, 99.0):
        assert (resting.at(stamp), moving.at(stamp), stopped.at(stamp)) == (0.3, None, None)
    assert (resting.at(102.0), moving.at(102.0), stopped.at(102.0)) == (0.3, None, 0.4)
    assert Past().at(1.0) is None


def test_nobody_knows_what_lay_in_a_gap():
    made = past(lambda t: float(t > 105.0), (104.0, 106.0))
    assert made.at(105.0) is None
    assert past(lambda t: 0.2, (104.0, 106.0)).at(105.0) == pytest.approx(0.2)


@pytest.mark.parametrize("rate", [10.0, 100.0, 1000.0])
def test_speed_is_measured_whatever_the_rate(rate):
    rng = np.random.default_rng(0)
    times = np.arange(100.0, 102.0, 1.0 / rate)
    for speed, moves in ((0.0, False), (0.015, False), (0.025, True), (-0.03, True), (3.0, True)):
        noisy = past(lambda t, v=speed: v * t + rng.uniform(-2e-4, 2e-4), times)
        assert [noisy.moves(t) for t in (100.5, 101.0, 101.9)] == [moves] * 3, speed


@settings(deadline=None)
@given(st.lists(st.tuples(STAMPS, POSITIONS), max_size=30), STAMPS)
def test_whatever_is_published_is_answered(values, stamp):
    made = Past()
    for each in values:
        made.add(Sample(*each))
    for asked in (stamp, None, *(each[0] for each in values)):
        found = made.at(asked)
        assert found is None or not math.isnan(found)
    assert made.moves(stamp) in (True, False)


@pytest.mark.parametrize("rate", [100.0, 5000.0])
def test_no_more_than_the_last_seconds_are_kept(rate):
    made = past(lambda t: 0.0, np.arange(0.0, 2.0 * HISTORY_S, 1.0 / rate))
    assert len(made._samples) <= HISTORY_S / SPACING_S + 2
    assert made._samples[0].time >= HISTORY_S - 2.0 / rate
    for _ in range(5000):
        made.add(Sample(5.0, 0.0))
    assert len(made._samples) <= HISTORY_S / SPACING_S + 2
