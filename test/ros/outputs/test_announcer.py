"""What the log says of a run as its search begins."""

from types import SimpleNamespace

import numpy as np
import pytest

from placement_planner_ros.ros.outputs.announcer import Announcer


def test_log_and_solution_say_the_same_time():
    lines, told = [], []
    outputs = SimpleNamespace(solution=lambda *given: told.append(given[3]))
    reporter = SimpleNamespace(placed=lambda *_: None)
    announcer = Announcer(outputs, reporter, SimpleNamespace(event=lines.append))

    class Run:
        number, solutions, snapshot = 7, 1, None
        passed = iter([0.74, 0.78])

        @property
        def elapsed(self):
            return next(self.passed)

    goal = SimpleNamespace(arm="left")
    announcer.placed(Run(), SimpleNamespace(objective=0.5, goal=goal))
    assert told == [0.74]
    assert "after 0.74 s" in lines[0]


@pytest.mark.parametrize(("flying", "said"), [(1234, ["1,234 of 5,000 points"]), (0, [])])
def test_the_log_says_how_many_points_were_left_out_as_flying_pixels(flying, said):
    lines, shown = [], []
    outputs = SimpleNamespace(environment=lambda *of: shown.append(of))
    reporter = SimpleNamespace(prepared=lambda *_: None)
    announcer = Announcer(outputs, reporter, SimpleNamespace(event=lines.append))
    clouds = np.zeros((4000, 3)), np.zeros((1000, 3))
    parameters = {"unknown_space": "free"}
    run = SimpleNamespace(number=7, snapshot=SimpleNamespace(clouds=clouds, parameters=parameters))
    planner = SimpleNamespace(unusable=())
    announcer.prepared(run, SimpleNamespace(planner=planner, flying=flying, environment=None))
    assert shown == [(run.snapshot, None)]
    assert len(lines) == len(said)
    for line, words in zip(lines, said, strict=True):
        assert words in line
        assert line.startswith("run 7:")
        assert "flying" in line
