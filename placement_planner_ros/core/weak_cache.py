"""`functools.lru_cache` whose results go with one of the arguments."""

from __future__ import annotations

import functools
import inspect
import weakref
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

Given = ParamSpec("Given")
Made = TypeVar("Made")


def weak_lru_cache(
    owner: str, maxsize: int
) -> Callable[[Callable[Given, Made]], Callable[Given, Made]]:
    """Cache the latest results for each value of an argument, which is not kept alive by them: an
    object of 200,000 triangles would stay in memory until `maxsize` grasps of others are looked at.

    All arguments are given by position.

    Args:
        owner: the name of that argument, which may be None; results must not hold it.
    """

    def decorate(make: Callable[..., Any]) -> Any:
        at = list(inspect.signature(make).parameters).index(owner)
        caches: weakref.WeakKeyDictionary[Any, Any] = weakref.WeakKeyDictionary()

        @functools.wraps(make)
        def cached(*given: Any) -> Any:
            of = make if given[at] is None else given[at]
            cache = caches.get(of)
            if cache is None:
                known = weakref.ref(of)

                def again(*others: Any) -> Any:
                    value = None if known() is make else known()
                    return make(*others[:at], value, *others[at:])

                cache = caches.setdefault(of, functools.lru_cache(maxsize)(again))
            return cache(*given[:at], *given[at + 1 :])

        cached.__dict__["cache_clear"] = caches.clear
        return cached

    return decorate
