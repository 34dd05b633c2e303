"""The page in a headless Chromium: it loads, shows a placement, plays, takes commands and changed
fields, and outlives the node."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from helpers.browser import Browser, chromium
from helpers.fakes import Bench
from rclpy.parameter import Parameter

import placement_planner_ros

pytestmark = pytest.mark.skipif(
    chromium() is None, reason="Chromium is missing: the page in the browser is not tested"
)


@pytest.fixture
def page(tmp_path):
    """`placement_view` as a user starts it; its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    root = Path(placement_planner_ros.__file__).parent.parent
    path = os.pathsep.join(filter(None, [str(root), os.environ.get("PYTHONPATH", "")]))
    command = [sys.executable, "-m", "placement_planner_ros", "placement_view", "--control"]
    with (tmp_path / "view.log").open("wb") as log:
        process = subprocess.Popen(
            [*command, "--port", str(port)],
            env={**os.environ, "PYTHONPATH": path},
            stdout=log,
            stderr=subprocess.STDOUT,
        )
    yield f"http://127.0.0.1:{port}"
    process.send_signal(signal.SIGINT)
    assert process.wait(300.0) == 0
    assert "Traceback" not in (tmp_path / "view.log").read_text()


PATIENT = {"joint_state_timeout": 600.0, "cloud.max_age": 0.0, "time_limit": 0.0}
"""A browser that draws without a graphics card may take its time."""


def find(b, browser, *texts):
    """Wait for texts, the sensors going on meanwhile."""
    end = time.monotonic() + 600.0
    while missing := [text for text in texts if text not in browser.text]:
        assert time.monotonic() < end, f"{missing} is not in {browser.text}"
        b.feed()


def test_the_page_shows_plays_commands_and_outlives_the_node(ros, page, tmp_path):
    profile = tmp_path / "profile"
    profile.mkdir()
    with Browser(profile, 480, 240) as browser:
        _open(browser, page)
        browser.wait_for("no node heard on /placement_planner")
        b = Bench(**PATIENT)
        try:
            find(b, browser, "No run yet.")
            b.feed()
            browser.press("Start")
            b.wait(lambda: b.planners and b.planners[0].searching.is_set(), again=b.feed)
            b.planners[0].retreats = True
            b.planners[0].statistics.rejected = {"unstable": 12}
            b.planners[0].offers += [0.1, 0.3]
            find(b, browser, "Placement 2", "ξ = 0.300", "unstable", "searching")
            browser.press("Stop")
            find(b, browser, "stopped", "It can be carried out.")
            browser.press("Play")
            find(b, browser, "now: retreat")
            browser.press("Confirm as placed")
            find(b, browser, "put down already")
            assert list(b.node._inputs.known.placed) == [1]
            browser.unfold("Parameters of the next start")
            volume = "0.2 -0.3 -0.1 0.6 0.3 0.2"
            b.wait(lambda: volume in browser.fields, again=b.feed)
            browser.fill(volume, "0.2 here")
            b.node.set_parameters([Parameter("edge_margin", value=0.004)])
            b.wait(lambda: "0.004" in browser.fields, again=b.feed)
            assert "0.2 here" in browser.fields  # what is typed outlives what the node changes
            browser.press("Start")
            find(b, browser, "not sent")
            browser.fill("0.2 here", "0.2 0 -0.1 0.6 0.3 0.2")
            b.feed()
            browser.press("Start")
            find(b, browser, "run 2 has begun with another target_volume")
            assert b.snapshots[1].parameters.volume.lower.tolist() == [0.2, 0.0, -0.1]
            find(b, browser, "No placement so far.")
            browser.press("Start")
            find(b, browser, "wait for its end, or stop it")
            assert "It can be carried out." not in browser.text
        finally:
            b.close()
        browser.wait_for("any more; what it said last is shown")
        again = Bench(first_run=5, **PATIENT)
        try:
            find(again, browser, "No run yet.", "No placement so far.")
            again.feed()
            assert again.call("start").success
            again.wait(lambda: again.planners and again.planners[0].searching.is_set())
            again.planners[0].offers.append(0.2)
            find(again, browser, "Placement 1", "ξ = 0.200")
        finally:
            again.close()
        assert not browser.errors


def _open(browser, address):
    """Once the page is served."""
    end = time.monotonic() + 300.0
    while True:
        try:
            with socket.create_connection(("127.0.0.1", int(address.rpartition(":")[2])), 1.0):
                break
        except OSError:
            assert time.monotonic() < end
            time.sleep(0.1)
    browser.open(address)
