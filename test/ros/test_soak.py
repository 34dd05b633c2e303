"""The node bears a few minutes of everything; `soak.py` by itself does it for an hour."""

import os

import pytest
from by_hand.soak import faults_of, soak
from helpers.domains import claimed_domain


@pytest.mark.soak
def test_the_node_bears_what_clients_and_sensors_do(tmp_path, monkeypatch):
    # What it published is still heard for a while: no other test is to take it for its own.
    monkeypatch.setenv("ROS_DOMAIN_ID", claimed_domain())
    report = soak(float(os.environ.get("SOAK_MINUTES", "3")), tmp_path)
    assert faults_of(report, short=True) == [], report
