"""Reading in the background: once per content, the newest first, never in the caller's thread."""

import threading
import time

import pytest

from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.ros.inputs.mesh_process import MeshProcessStoppedError
from placement_planner_ros.ros.inputs.reading import NotReadyError, Reading


class Gate:
    """A content whose reading lasts until it is let through, or told to stop."""

    def __init__(self, made="made"):
        self.made = made
        self.open = threading.Event()
        self.reads = 0
        self.threads = set()
        self.stopped = False

    def __call__(self, should_stop):
        self.reads += 1
        self.threads.add(threading.current_thread())
        while not self.open.wait(0.002):
            if should_stop():
                self.stopped = True
                raise MeshProcessStoppedError
        if isinstance(self.made, BaseException):
            raise self.made
        return self.made


@pytest.fixture
def reading():
    made = Reading("object", ObjectError)
    yield made
    made.close()
    until(lambda: not made.busy)


def until(condition):
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.002)


def test_a_content_is_read_once_elsewhere_and_nobody_waits(reading):
    gate = Gate()
    for _ in range(5):
        reading.want("a", gate)
        assert reading.state("a") == "reading"
        with pytest.raises(NotReadyError) as error:
            reading.get("a")
        assert error.value.code == "NOT_READY"
    gate.open.set()
    reading.wait("a")
    reading.want("a", gate)
    assert (reading.get("a"), reading.state("a"), gate.reads) == ("made", "ready", 1)
    assert threading.current_thread() not in gate.threads
    assert reading.state("b") == "none"


@pytest.mark.parametrize(
    "error", [RecursionError("deep"), MemoryError(), IndexError("3"), AssertionError("so")]
)
def test_whatever_reading_raises_is_told_until_something_else_is_wanted(reading, error):
    gate = Gate(error)
    gate.open.set()
    reading.want("a", gate)
    reading.wait("a")
    assert reading.state("a") == "bad"
    for _ in range(2):
        with pytest.raises(ObjectError, match=type(error).__name__):
            reading.get("a")
    reading.forget("a")
    reading.want("a", Gate("good"))
    assert reading.state("a") == "reading"


def test_what_is_replaced_is_stopped_and_the_newest_is_read_next(reading):
    old, middle, new = Gate(), Gate(), Gate()
    reading.want("old", old)
    until(lambda: old.reads)
    reading.want("middle", middle)
    reading.want("new", new)
    reading.forget("old")
    until(lambda: new.reads)
    assert old.stopped
    assert middle.reads == 0
    new.open.set()
    middle.open.set()
    reading.wait("middle")
    assert reading.get("new") == reading.get("middle") == "made"


def test_closing_ends_what_is_being_read(reading):
    gate = Gate()
    reading.want("a", gate, lasting=True)
    until(lambda: gate.reads)
    reading.close()
    assert gate.stopped
    assert not reading.busy
