"""Results that are remembered as long as one of the things they are of is there."""

from __future__ import annotations

import functools
import inspect
import weakref
from collections.abc import Callable
from typing import Generic, ParamSpec, TypeVar

Given = ParamSpec("Given")
Made = TypeVar("Made")


class _Nothing:
    """Stands for None, which nothing can refer to weakly."""


_NOTHING = _Nothing()


class Remembered(Generic[Given, Made]):
    """A function whose results go with one of its arguments, of which it keeps the latest.

    `functools.lru_cache` keeps its arguments alive: an object of 200,000 triangles stayed in memory
    until sixty-four grasps of others had been looked at. All arguments are given by position.

    Args:
        make: the function.
        owner: the name of that argument, which may be None; results must not hold it.
        most: results that are kept for each.
    """

    def __init__(self, make: Callable[Given, Made], owner: str, most: int) -> None:
        self._make: Callable[..., Made] = make
        self._most = most
        self._at = list(inspect.signature(make).parameters).index(owner)
        self._of: weakref.WeakKeyDictionary[object, Callable[..., Made]] = (
            weakref.WeakKeyDictionary()
        )
        functools.update_wrapper(self, make)

    def __call__(self, *given: Given.args, **named: Given.kwargs) -> Made:
        owner = given[self._at]
        others = given[: self._at] + given[self._at + 1 :]
        return self._results(_NOTHING if owner is None else owner)(*others)

    def forget(self) -> None:
        """Remember nothing."""
        self._of.clear()

    def _results(self, owner: object) -> Callable[..., Made]:
        found = self._of.get(owner)
        if found is not None:
            return found
        known, make, at = weakref.ref(owner), self._make, self._at

        @functools.lru_cache(maxsize=self._most)
        def results(*others: object) -> Made:
            of = known()  # the caller has it
            again = *others[:at], None if of is _NOTHING else of, *others[at:]
            return make(*again)

        return self._of.setdefault(owner, results)


def remembered_with(
    owner: str, most: int = 1
) -> Callable[[Callable[Given, Made]], Remembered[Given, Made]]:
    """Decorate a function as `Remembered` has it."""
    return lambda make: Remembered(make, owner, most)
