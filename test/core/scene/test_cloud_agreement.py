"""Two cameras that see the same surfaces at different heights."""

import numpy as np
import pytest

from placement_planner_ros.core.scene.cloud_agreement import disagreements
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import TargetVolume

TOLERANCE = 0.003


def table(height, seed, deviation=0.001, low=(0.2, -0.3), high=(0.8, 0.3), spacing=0.003):
    rng = np.random.default_rng(seed)
    x, y = (np.arange(a, b, spacing) for a, b in zip(low, high, strict=True))
    points = np.stack([*np.meshgrid(x, y), np.full((len(y), len(x)), height)], -1).reshape(-1, 3)
    return points + rng.normal(0.0, (1e-4, 1e-4, deviation), points.shape)


def told(first, second, apart=0.0):
    return disagreements([first, second], ["left", "right"], [0.0, apart], TOLERANCE)


@pytest.mark.parametrize("off", [0.008, 0.015, -0.015, 0.06, -0.1])
@pytest.mark.parametrize("deviation", [0.0, 0.002])
def test_cameras_that_are_off_are_told_with_how_much_and_which_way(off, deviation):
    (found,) = told(table(0.0, 0, deviation), table(off, 1, deviation), apart=30.0)
    assert found.height == pytest.approx(off, abs=0.001)
    assert ("above left" if off > 0.0 else "below left") in str(found)
    assert f"{abs(found.height):.4f}" in str(found)


@pytest.mark.parametrize("off", [0.003, 0.005])
def test_ordinary_calibrations_are_no_reason_to_put_nothing_down(off):
    assert not sum(len(each.points) for each in told(table(0.0, 0), table(off, 1)))


def test_what_sees_the_same_does_not_contradict():
    assert not told(table(0.0, 0, 0.003), table(0.0, 1, 0.003))
    assert not told(table(0.0, 0), table(0.015, 1, low=(1.0, -0.3), high=(1.5, 0.3)))
    assert not told(table(0.0, 0), table(0.2, 1))  # the next board of a shelf


def test_what_was_put_down_between_two_clouds_is_no_contradiction():
    book = table(0.03, 2, low=(0.4, -0.1), high=(0.6, 0.1))
    around = table(0.0, 1)
    inside = ((around[:, :2] > (0.4, -0.1)) & (around[:, :2] < (0.6, 0.1))).all(axis=1)
    after = np.vstack([around[~inside], book])
    assert not told(table(0.0, 0), after, apart=5.0)
    assert told(table(0.0, 0), after)


def test_a_camera_that_leans_is_told_though_half_of_it_is_above():
    leaning = table(0.0, 1)
    leaning[:, 2] += 0.05 * (leaning[:, 0] - 0.5)
    for apart in (0.0, 30.0):
        assert {"above" in str(each) for each in told(table(0.0, 0), leaning, apart)} == {
            True,
            False,
        }


def barred_in(first, second):
    """Which cells of both nothing is put down on, and their middles (n, 3)."""
    volume = TargetVolume(np.array([0.2, -0.3, -0.1]), np.array([0.8, 0.3, 0.2]))
    made = Environment.from_points(np.vstack([first, second]), volume)
    barred = made.with_disagreements(told(first, second)).obstacles.barred
    return barred, (made.obstacles.lower + made.obstacles.upper) / 2


def test_nothing_is_put_down_where_a_part_contradicts_and_elsewhere_it_is():
    raised = table(0.012, 1, low=(0.6, -0.3))
    second = np.vstack([table(0.0, 2, high=(0.6, 0.3)), raised])
    barred, middle = barred_in(table(0.0, 0), second)
    both = (middle[:, 0] > 0.62) & (np.abs(middle[:, 2]) < 0.05)
    assert barred[both].mean() > 0.97
    assert not barred[middle[:, 0] < 0.58].any()


@pytest.mark.parametrize("whole", [True, False])
def test_a_camera_that_is_off_is_off_where_it_alone_sees_too(whole):
    first, second = table(0.0, 0, high=(0.6, 0.3)), table(-0.015, 1, low=(0.4, -0.3))
    # of what both see little is squares of 6 by 6 cm
    seen = whole | (second[:, 0] > 0.6) | (second[:, 1] % 0.06 < 0.04) | (second[:, 1] < -0.22)
    barred, middle = barred_in(first, second[seen])
    assert barred[np.abs(middle[:, 2]) < 0.05].mean() > 0.97
