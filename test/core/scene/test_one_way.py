"""A cloud goes one way: no file is come back to between it and its `Environment`."""

import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from placement_planner_ros.core.scene import environment as whole
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import TargetVolume

VOLUME = TargetVolume([-0.2, -0.2, -0.05], [0.2, 0.2, 0.3])


def table_with_boxes(noise):
    rng = np.random.default_rng(0)
    x, y = (each.ravel() for each in np.meshgrid(*2 * [np.arange(-0.3, 0.3, 0.003)]))
    on_box = (np.hypot(x - 0.1, y) < 0.06) * 0.11 + (np.hypot(x + 0.1, y) < 0.06) * 0.04
    return np.column_stack([x, y, on_box]) + rng.normal(0.0, noise, (len(x), 3))


def entered(run):
    """How often each file of the room was entered while nothing of it ran.

    Kernels do not count, nor what a thing that is made is asked as an attribute.
    """
    times, running = Counter(), Counter()
    room = str(Path(whole.__file__).parent)

    def watch(frame, event, _):
        name = frame.f_code.co_filename
        if not name.startswith(room) or frame.f_back is None:  # kernels come from nowhere
            return
        asked = getattr(type(frame.f_locals.get("self")), frame.f_code.co_name, None)
        way_in = event == "call" and not running[name] and not isinstance(asked, property)
        times[Path(name).stem] += way_in
        running[name] += {"call": 1, "return": -1}.get(event, 0)

    sys.setprofile(watch)
    try:
        run()
    finally:
        sys.setprofile(None)
    return times


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_no_file_is_left_and_entered_again(noise):
    points = table_with_boxes(noise)
    found = []
    times = entered(lambda: found.append(Environment.from_points(points, VOLUME)))
    assert len(found[0].support.heights(VOLUME, 0.01, 0.002)) == 3
    assert len(times) <= 10
    assert {name: number for name, number in times.items() if number > 1} == {}
