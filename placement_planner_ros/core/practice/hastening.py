"""What numba may do without in a process that does nothing but compile.

For the rest of that process; the code it makes is the same. Where numba is built otherwise than
here is told, nothing but time is lost.
"""

from __future__ import annotations

import contextlib
import gc
import operator
from typing import Any

import llvmlite.binding as llvm
from numba.core import types
from numba.core.registry import cpu_target

_OPERATORS = frozenset(f for f in vars(operator).values() if callable(f))
_PLAIN = (types.Number, types.Boolean, types.Array, types.UniTuple)
"""Kinds of operands that decide alone which of numba's functions an operator is."""


def hasten() -> None:
    """Compile faster from now on."""
    gc.set_threshold(100_000, 50, 100)  # collecting what the compiler leaves took a tenth
    with contextlib.suppress(AttributeError):
        # What it notes, for those who watch it, around each call of LLVM: a twentieth.
        llvm.ffi.lib._lock._cblist.clear()
    _remember_operators()


def _remember_operators() -> None:
    """Look up once which function an operator is for operands of these types: a twentieth."""
    context = cpu_target.typing_context
    resolve = context.resolve_function_type
    known: dict[tuple[Any, ...], Any] = {}

    def resolved(function: Any, args: Any, kws: Any) -> Any:
        plain = all(isinstance(given, _PLAIN) for given in args)
        if not plain or kws or getattr(function, "typing_key", None) not in _OPERATORS:
            return resolve(function, args, kws)
        asked = (function.typing_key, *args)
        found = known.get(asked) or resolve(function, args, kws)
        if found is not None:
            known[asked] = found
        return found

    context.resolve_function_type = resolved
