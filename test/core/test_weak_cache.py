"""Results are cached as long as what they are of is there, and no longer."""

import weakref

from placement_planner_ros.core.weak_cache import weak_lru_cache


class Thing:
    pass


def test_a_result_is_kept_and_what_it_is_of_is_not_kept_alive():
    made = []

    @weak_lru_cache("thing", maxsize=2)
    def told(thing, number):
        made.append(number)
        return number

    thing = Thing()
    assert [told(thing, 1), told(thing, 1)] == [1, 1]
    assert made == [1]
    gone = weakref.ref(thing)
    del thing
    assert gone() is None
