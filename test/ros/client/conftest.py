"""A bench whose sensors go on, and a client of its node."""

import pytest
from helpers.fakes import Bench
from helpers.searches import Sensors, service_of

from placement_planner_ros.client import Answer, PlacementClient, conversation, placement_client


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """A client that waits for answers however slow the machine is."""
    for module in (conversation, placement_client):
        monkeypatch.setattr(module, "ANSWER_WITHIN", 120.0)


@pytest.fixture
def fed(bench):
    """A bench whose node has its inputs, and goes on getting joint states."""
    b: Bench = bench()
    b.feed()
    b.sensors = Sensors(b)
    yield b
    b.sensors.close()


@pytest.fixture
def planner(fed):
    """A client with a node of its own."""
    with PlacementClient() as made:
        made.wait_until_ready(600.0)
        yield made


@pytest.fixture
def answers(fed):
    """What `~/start_with` has answered so far."""
    given = []
    service = service_of(fed)
    respond = service.callback

    def remembering(request, response):
        response = respond(request, response)
        given.append(Answer.of(response))
        return response

    service.callback = remembering
    return given
