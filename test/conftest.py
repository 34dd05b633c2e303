"""Keeps runs apart from each other, begins with what takes longest, and says what was left out."""

import os
from collections import Counter

import pytest
from helpers.domains import claimed_domain

from placement_planner_ros.core.kernels import use_kernel_folder

# Before rclpy is first imported: it reads these when its context starts.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_DOMAIN_ID"] = claimed_domain()
# Before numba is: it keeps kernels where this says, in all processes that tests begin.
use_kernel_folder()

LEFT_OUT = Counter()
"""Tests by the reason why they were never begun: deselected, or of a file that was skipped."""


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """The soak, then what waits for nodes; else one process would be left with them in the end."""
    items.sort(key=lambda item: ("soak" not in item.keywords, "/ros/" not in str(item.path)))


def pytest_deselected(items):
    LEFT_OUT["deselected by -m, -k or --deselect"] += len(items)


def pytest_collectreport(report):
    if report.skipped:
        LEFT_OUT[f"all of {report.nodeid}: {_reason(report)}"] += 1


def pytest_sessionfinish(session):
    if hasattr(session.config, "workeroutput"):  # one of several processes
        session.config.workeroutput["left_out"] = dict(LEFT_OUT)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    """Each process collects all tests, so what they have left out is the same."""
    LEFT_OUT.update(Counter(getattr(node, "workeroutput", {}).get("left_out", {})) - LEFT_OUT)


def pytest_terminal_summary(terminalreporter):
    for report in terminalreporter.stats.get("skipped", []):
        if report.when != "collect":
            LEFT_OUT[_reason(report)] += 1
    if LEFT_OUT:
        terminalreporter.section("left out", "=", yellow=True)
        for reason, count in LEFT_OUT.most_common():
            terminalreporter.write_line(f"{count:5} {reason}", yellow=True)


def _reason(report):
    return report.longrepr[2].removeprefix("Skipped: ")
