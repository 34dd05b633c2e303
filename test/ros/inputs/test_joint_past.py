import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from placement_planner_ros.ros.inputs.joint_past import SPACING_S, WINDOW_S, JointPast, Sample

REST_SPEED = 0.02


def past(position, times):
    made = JointPast(Sample(float(times[0]), float(position(times[0]))))
    for t in times[1:]:
        made.add(Sample(float(t), float(position(t))))
    return made


@pytest.mark.parametrize("rate", [2.0, 10.0, 100.0, 1000.0])
def test_speed_is_measured_whatever_the_rate(rate):
    rng = np.random.default_rng(0)
    times = np.arange(100.0, 102.0, 1.0 / rate)
    for speed, moves in ((0.0, False), (0.015, False), (0.025, True), (-0.03, True), (3.0, True)):
        noisy = past(lambda t, v=speed: v * t + rng.uniform(-2e-4, 2e-4), times)
        assert noisy.moves(REST_SPEED) is moves, speed


def test_since_when_it_rests_is_known():
    times = np.arange(100.0, 105.0, 0.01)
    stopped = past(lambda t: 0.3 + min(t - 100.0, 0.1), times)
    assert [stopped.rested_since(t) for t in (99.0, 100.05, 100.2, 104.9, 200.0)] == [
        False,
        False,
        True,
        True,
        True,
    ]
    assert past(lambda t: 0.3, times).rested_since(0.0), "as far as anybody heard"


def test_with_a_clock_that_stands_still_what_changes_moves():
    assert past(lambda t: 0.0, (5.0,) * 3).moves(REST_SPEED) is False
    made = past(lambda t: 0.0, (5.0,))
    for k in range(20):
        made.add(Sample(5.0, 0.01 * k))
    assert made.moves(REST_SPEED) is True


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(0.0, 1e3), st.floats(-1e300, 1e300)), max_size=30))
def test_whatever_is_published_is_answered(values):
    made, time = JointPast(Sample(0.0, 0.0)), 0.0
    for step, position in values:
        time += step
        made.add(Sample(time, position))
    assert made.moves(REST_SPEED) in (True, False)


@pytest.mark.parametrize("rate", [100.0, 5000.0])
def test_no_more_than_the_window_is_kept(rate):
    made = past(lambda t: 0.0, np.arange(0.0, 3.0, 1.0 / rate))
    assert len(made._samples) <= WINDOW_S / SPACING_S + 3
    for _ in range(5000):
        made.add(Sample(5.0, 0.0))
    assert len(made._samples) <= WINDOW_S / SPACING_S + 3
