"""Compilation of kernels that make no arrays.

Arrays that are handed to a kernel belong to its caller, yet numba counts a reference to each of
them, those within tuples too: with the tuples of the collision check that takes longer than most
of its calls. Kernels that make no array, not even for a while, can go without.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit
from numba.core.options import DefaultOptions

_F = TypeVar("_F", bound=Callable[..., Any])
_UNCOUNTED: dict[str, Any] = {"_nrt": False} if hasattr(DefaultOptions, "_nrt") else {}


def njit_lean(nogil: bool = False) -> Callable[[_F], _F]:
    """`numba.njit`, cached, without references counted; it does not compile what makes arrays."""
    decorator: Callable[[_F], _F] = njit(cache=True, nogil=nogil, **_UNCOUNTED)
    return decorator
