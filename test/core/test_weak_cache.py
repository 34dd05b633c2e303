"""Results are cached as long as what they are of is there, and no longer."""

import weakref

import pytest

from placement_planner_ros.core.weak_cache import weak_lru_cache


class Thing:
    pass


@pytest.fixture
def made():
    return []


@pytest.fixture
def told(made):
    @weak_lru_cache("thing", maxsize=2)
    def told(word, thing, number):
        made.append((word, number))
        return word, thing is None, number

    return told


def test_it_is_made_once_for_the_same_arguments(told, made):
    one, other = Thing(), Thing()
    for _ in range(2):
        assert told("a", one, 1) == ("a", False, 1)
        assert told("a", other, 1) == ("a", False, 1)
        assert told("a", None, 1) == ("a", True, 1)
    assert made == [("a", 1)] * 3
    told("b", one, 1)
    told("a", one, 2)  # a third one
    told("a", one, 1)
    told("a", one, 2)
    assert made[3:] == [("b", 1), ("a", 2), ("a", 1)]
    told.cache_clear()
    told("a", other, 1)
    assert made[6:] == [("a", 1)]


def test_what_it_is_of_is_not_kept_alive(told):
    thing = Thing()
    told("a", thing, 1)
    gone = weakref.ref(thing)
    del thing
    assert gone() is None
