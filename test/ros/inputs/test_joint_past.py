import numpy as np
import pytest

from placement_planner_ros.ros.inputs.joint_past import JointPast, Sample

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
