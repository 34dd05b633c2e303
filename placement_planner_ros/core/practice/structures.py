"""Arrays, ranges and pairs as values in what numba writes for LLVM, instead of in memory."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

from llvmlite.ir import Constant
from numba.core import cgutils, types
from numba.np import arrayobj

from placement_planner_ros.core.practice.replacing import replace


def keep_structures_as_values() -> None:
    """Read the parts of an array, a range or a pair from it as it is, and put them in there.

    Numba writes each to memory first. Here that is done where a part is put in on one of several
    ways, or somebody asks for the place.
    """
    proxy = cgutils._StructProxy
    make, put, take = proxy.__init__, proxy.__setitem__, proxy.__getitem__
    named, whole = proxy.__getattr__, proxy._getvalue

    def made(self: Any, context: Any, builder: Any, value: Any = None, ref: Any = None) -> None:
        self._since = None
        is_value = ref is None and isinstance(self, cgutils.ValueStructProxy)
        if not is_value or not isinstance(self._fe_type, _READ_ONLY):
            make(self, context, builder, value, ref)
            return
        self._context, self._builder = context, builder
        self._datamodel = context.data_model_manager[self._fe_type]
        self._be_type = self._get_be_type(self._datamodel)
        self._given = Constant(self._be_type, None) if value is None else value
        assert self._given.type == self._be_type
        self._since = _Since(builder)

    def put_in(self: Any, index: int, value: Any) -> None:
        since = self._since
        if since is None or not since.is_here or value.type != self._be_type.elements[index]:
            put(self, index, value)  # which asks for the place
        else:
            self._given = self._builder.insert_value(self._given, value, index)
            self._since = _Since(self._builder)

    def taken(self: Any, index: int) -> Any:
        if self._since is None:
            return take(self, index)
        self._since.note_read()
        return self._builder.extract_value(self._given, index)

    def all_of(self: Any) -> Any:
        if self._since is None:
            return whole(self)
        self._since.note_read()
        return self._given

    def of_name(self: Any, name: str) -> Any:
        since = vars(self).get("_since")
        if name in ("_value", "_outer_ref") and since is not None:
            self._since = None
            self._value = self._outer_ref = since.put_into_memory(self._given)
            return self._value
        return named(self, name)

    replace(
        proxy,
        __init__=made,
        __setitem__=put_in,
        __getitem__=taken,
        __getattr__=of_name,
        _getvalue=all_of,
    )


_READ_ONLY = (types.Array, types.Pair, types.RangeType, types.RangeIteratorType)
"""Types whose values hardly anything writes to once they are whole."""


class _Since:
    """Where in the code a structure has its value."""

    def __init__(self, builder: Any) -> None:
        self._builder = builder
        self._block = builder.block
        self._after = self._block.instructions[-1] if self._block.instructions else None
        self._is_read_elsewhere = False

    @property
    def is_here(self) -> bool:
        """Whether what is written now comes after it, and on no other way."""
        return self._builder.block is self._block

    def note_read(self) -> None:
        """That it is read as it was."""
        self._is_read_elsewhere |= not self.is_here

    def put_into_memory(self, value: Any) -> Any:
        """Give it a place, and put it there where it has its value.

        Raises:
            AssertionError: it was read on another way, where what is put in now may be missed.
        """
        assert not self._is_read_elsewhere, "a structure is written to after it was read elsewhere"
        builder, block = self._builder, self._builder.block
        assert builder._anchor == len(block.instructions)
        builder.position_at_start(builder.function.entry_basic_block)
        place = builder.alloca(value.type)
        if self._after is not None:
            builder.position_after(self._after)
        elif self._block is builder.function.entry_basic_block:
            builder.position_after(place)
        else:
            builder.position_at_start(self._block)
        builder.store(value, place)
        builder.position_at_end(block)
        return place


def make_arrays_once() -> None:
    """Make the class for arrays of each type once.

    It also marks each length as positive where it is read from memory, which is gone with that.
    """
    make = arrayobj.make_array

    @functools.cache
    def made(kind: Any) -> Any:
        structure = make(kind)
        if kind.ndim and kind.as_array is kind:
            del structure.shape
        return structure

    replace(arrayobj, make_array=made)


def index_with_what_it_takes() -> None:
    """Take of an array's shape and strides what an index needs, not all of both twice."""
    index, unpack = arrayobj.basic_indexing, cgutils.unpack_tuple

    @functools.wraps(index)
    def indexed(context: Any, builder: Any, kind: Any, array: Any, *args: Any, **kws: Any) -> Any:
        return index(context, builder, kind, _Indexed(array, builder), *args, **kws)

    def unpacked(builder: Any, given: Any, count: Any = None) -> Any:
        return given if isinstance(given, _Parts) else unpack(builder, given, count)

    replace(arrayobj, basic_indexing=indexed)
    replace(cgutils, unpack_tuple=unpacked)


class _Indexed:
    """An array that is only read, its shape and strides in parts."""

    def __init__(self, array: Any, builder: Any) -> None:
        self._array = array
        self.shape = _Parts(array.shape, builder)
        self.strides = _Parts(array.strides, builder)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._array, name)


class _Parts:
    """The numbers in an LLVM array, each taken out when it is asked for."""

    def __init__(self, given: Any, builder: Any) -> None:
        self._given = given
        self._builder = builder

    def __len__(self) -> int:
        return int(self._given.type.count)

    def __getitem__(self, at: int | slice) -> Any:
        if isinstance(at, slice):
            return [self[k] for k in range(*at.indices(len(self)))]
        return self._builder.extract_value(self._given, at)

    def __iter__(self) -> Iterator[Any]:
        return (self[k] for k in range(len(self)))
