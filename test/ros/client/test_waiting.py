"""Waiting in asyncio."""

import asyncio
import math
import time

import pytest

from placement_planner_ros.client.waiting import News, finish, finish_async


def waiting(left):
    """Steps that wait for ever; notes what they are left by."""
    try:
        while True:
            yield math.inf
    except BaseException as error:
        left.append(type(error))
        raise


def test_a_cancellation_that_comes_with_news_is_not_lost():
    async def cancelling():
        news, left = News(), []
        for _ in range(20):
            task = asyncio.create_task(finish_async(waiting(left), news))
            await asyncio.sleep(0.005)
            news.tell()
            await asyncio.sleep(0)  # the loop has set the event, the task has not gone on yet
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await asyncio.wait_for(asyncio.shield(task), 5.0)
        return left

    assert asyncio.run(cancelling()) == [asyncio.CancelledError] * 20


def test_steps_go_on_when_their_time_has_come():
    def timed():
        end = time.monotonic() + 0.05
        while time.monotonic() < end:
            yield end
        return "done"

    assert finish(timed(), News()) == "done"
    assert asyncio.run(finish_async(timed(), News())) == "done"


def test_steps_that_are_dropped_are_closed():
    news, left = News(), []

    async def dropping():
        coroutine = finish_async(waiting(left), news)
        coroutine.send(None)
        coroutine.close()

    asyncio.run(dropping())
    assert left == [GeneratorExit]
