"""Simulated time that comes late, stands still and jumps: nothing of the node waits for it."""

import functools
import time

import numpy as np
from builtin_interfaces.msg import Time
from helpers.fakes import TABLE
from rosgraph_msgs.msg import Clock


def test_runs_live_with_any_clock(bench):
    b = bench(use_sim_time=True, **{"cloud.max_age": 3600.0})
    clock = b.client.create_publisher(Clock, "/clock", 10)

    def now():
        return b.node.get_clock().now().nanoseconds

    def start(stamp, **parameters):
        """A run on a cloud with that stamp."""
        updates, runs = b.node._inputs.clouds.updates, len(b.planners)

        def feed():
            b.cloud(TABLE, stamp=stamp)
            b.joint_state()

        b.wait(lambda: b.node._inputs.clouds.updates > updates, again=feed)
        b.wait(lambda: b.call("start_with", **parameters).success, again=b.joint_state)
        assert 0.0 <= b.node._inputs.clouds.ages(time.monotonic())["points"] < 3600.0
        b.wait(lambda: len(b.planners) > runs)

    def solve(stamp):
        start(stamp, time_limit=0)
        b.planners[-1].offers.append(0.1)
        run = str(len(b.planners))
        b.wait(lambda: [b.manifests()[-1][name] for name in ("run", "solution")] == [run, "1"])
        answer = b.call("stop")
        assert (answer.code, answer.run) == ("OK", run)

    # Nobody publishes /clock yet.
    assert now() == 0
    solve(Time())
    said = len(b.messages("diagnostics"))
    b.wait(lambda: len(b.messages("diagnostics")) > said)
    # It begins, leaps, is set back to its beginning as by a recording in a loop, and stands still.
    times = [Time(sec=s) for s in (1000, 2_000_000, 3)]
    for at in times:
        tick = functools.partial(clock.publish, Clock(clock=at))
        b.wait(lambda at=at: now() == at.sec * 10**9, again=tick)
        solve(at)
    start(times[-1], time_limit=0.2)
    b.wait(lambda: b.status()["state"] == "time_limit")
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in b.messages("solution")]
    assert (np.diff(stamps) > 0).all()
