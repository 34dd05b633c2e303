"""What `ros2 topic echo` shows of status and solutions is made to be read."""

import re

from helpers.fakes import ended, started

SHOWN = 128
"""Characters of a text that `ros2 topic echo` shows."""
FOUND = 0.1 + 0.2
"""Whose shortest exact form has 17 digits."""


def test_a_solution_is_said_in_a_line(bench):
    b = bench()
    started(b).offers.append(FOUND)
    b.wait(lambda: b.manifests() and b.manifests()[-1]["solution"] == "1")
    said = b.messages("solution")[-1].status[0].message
    assert re.fullmatch(
        r"solution 1 after \d+\.\d\d s: arm left, to (-?\d\.\d{3} ){3}in \w+, objective 0\.3, "
        r"motion \d+\.\d s",
        said,
    )
    assert len(f"{said}, retreat 10.5 s") < SHOWN - 5  # room for two digits more here and there


def test_a_status_says_where_the_run_is_and_what_it_has_found(bench):
    b = bench()
    b.wait(lambda: b.status() and "waiting for start" in b.messages("status")[-1].message)
    planner = started(b)
    b.wait(lambda: b.status()["state"] == "searching")
    said = b.messages("status")[-1].message
    assert re.fullmatch(r"searching for \d+ s, [\d,]+ samples, no solution yet", said)
    planner.offers += [FOUND, 0.5]
    b.wait(lambda: "2 solutions, the best 0.5 by arm left" in b.messages("status")[-1].message)
    run = int(b.call("stop").run)
    ended(b, run, "stopped")
    said = b.messages("status")[-1].message
    assert said.startswith("stopped: 2 solutions, the best 0.5 by arm left")
    assert b.call("confirm_placed").success
    b.wait(lambda: b.messages("status")[-1].message.endswith("; it has been carried out"))
