"""The node bears a minute of everything; `soak.py` by itself does it for an hour."""

import os

import pytest
from by_hand import soak
from helpers.domains import claimed_domain


@pytest.mark.soak
def test_the_node_bears_what_clients_and_sensors_do(tmp_path, monkeypatch):
    # What it published is still heard for a while: no other test is to take it for its own.
    monkeypatch.setenv("ROS_DOMAIN_ID", claimed_domain())
    report = soak.soak(float(os.environ.get("SOAK_MINUTES", "1")), tmp_path)
    assert soak.faults_of(report, short=True) == [], report


def test_no_other_node_answers_a_soak(monkeypatch):
    # a node of a test in the same domain was asked to remove what it did not know, and said so
    class BegunError(Exception):
        pass

    def begun(*_):
        raise BegunError(os.environ["ROS_DOMAIN_ID"])

    monkeypatch.setenv("ROS_DOMAIN_ID", "0")
    monkeypatch.setattr("sys.argv", ["soak"])
    monkeypatch.setattr(soak, "soak", begun)
    with pytest.raises(BegunError, match=r"[1-9]\d*"):
        soak.main()
