"""However `place` is left before it is done, the run is stopped."""

import threading

import pytest
from helpers.searches import Doing, ended, found, searching, service_of

from placement_planner_ros.client import PlacementClient, PlacementError, conversation
from placement_planner_ros.client.waiting import News
from placement_planner_ros.ros.run import worker


@pytest.fixture
def held(fed):
    """Holds start's answers back once a run has begun, until it is set."""
    gate = threading.Event()
    service = service_of(fed)
    respond = service.callback

    def holding(request, response):
        response = respond(request, response)
        gate.wait(600.0)
        return response

    service.callback = holding
    yield gate
    gate.set()


def was_stopped(b):
    b.wait(lambda: ended(b))
    return b.node._commands.run.state is worker.State.STOPPED


def test_a_start_whose_answer_does_not_come_is_stopped_once_it_does(fed, held, monkeypatch):
    with PlacementClient() as planner:
        planner.wait_until_ready(600.0)
        monkeypatch.setattr(conversation, "ANSWER_WITHIN", 0.3)
        with pytest.raises(PlacementError) as raised:
            planner.start()
        assert raised.value.code == "NO_ANSWER"
        searching(fed)
        assert not ended(fed)
        held.set()
        assert was_stopped(fed)


def test_a_refusal_that_comes_late_stops_nobodys_run(fed, held, planner, monkeypatch):
    assert fed.call("start").success
    searching(fed)
    sent, send = [], conversation.Conversation._send
    monkeypatch.setattr(
        conversation.Conversation,
        "_send",
        lambda self, name, parameters: sent.append(name) or send(self, name, parameters),
    )
    with monkeypatch.context() as hasty:
        hasty.setattr(conversation, "ANSWER_WITHIN", 0.3)
        with pytest.raises(PlacementError) as raised:
            planner.start()
    assert raised.value.code == "NO_ANSWER"
    held.set()
    with pytest.raises(PlacementError) as raised:  # answered after the first
        planner.start()
    assert raised.value.code == "ALREADY_RUNNING"
    assert sent == ["start_with", "start_with"]
    assert not ended(fed)


def test_withdrawing_from_another_thread_stops_the_run(fed, planner):
    placing = Doing(lambda: planner.place({}, 600.0))
    found(fed, 0.5)
    planner.withdraw()
    assert (placing.error.code, placing.error.run) == ("WITHDRAWN", 1)
    assert ended(fed)
    assert was_stopped(fed)
    placing = Doing(lambda: planner.place({}, 600.0, until=lambda s: True))
    found(fed, 0.5, number=2)
    assert placing.result.run == 2


def test_an_interrupt_stops_the_run(fed, planner, monkeypatch):
    wait = News.wait

    def interrupted(self, count, until):
        if fed.planners and fed.planners[0].searching.is_set():
            monkeypatch.setattr(News, "wait", wait)
            raise KeyboardInterrupt
        wait(self, count, until)

    monkeypatch.setattr(News, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        planner.place({}, 600.0)
    assert ended(fed)
    assert was_stopped(fed)


def test_closing_stops_the_run(fed):
    with PlacementClient() as planner:
        placing = Doing(lambda: planner.place({}, 600.0))
        searching(fed)
    assert placing.error.code == "WITHDRAWN"
    assert was_stopped(fed)
