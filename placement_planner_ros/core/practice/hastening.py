"""What numba may do without in a process that does nothing but compile.

For the rest of that process; the code it makes is the same. What stands in the place of numba's own
functions is as those of one version are: with another one nothing but time is lost.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import operator
import sys
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
import numba
from llvmlite.ir import IRBuilder, instructions
from numba.core import cgutils, inline_closurecall, ir, postproc, types, utils
from numba.core.annotations.type_annotations import TypeAnnotation
from numba.core.registry import cpu_target
from numba.core.runtime.context import NRTContext
from numba.np import arrayobj

_WRITTEN_FOR = "0.68."
"""How the versions of numba begin whose functions `SHORTCUTS` stand for."""
_OPERATORS = frozenset(f for f in vars(operator).values() if callable(f))
_PLAIN = (types.Number, types.Boolean, types.Array, types.UniTuple)
"""Kinds of operands that decide alone which of numba's functions an operator is."""


def hasten() -> None:
    """Compile faster from now on."""
    gc.set_threshold(100_000, 50, 100)  # collecting what the compiler leaves took a tenth
    with contextlib.suppress(AttributeError):
        # What it notes, for those who watch it, around each call of LLVM: a twentieth.
        llvm.ffi.lib._lock._cblist.clear()
    if numba.__version__.startswith(_WRITTEN_FOR):
        for shortcut in SHORTCUTS:
            shortcut()


def _replace(owner: Any, **by: Any) -> None:
    """Put these in the place of numba's own of those names."""
    for name, made in by.items():
        setattr(owner, name, made)


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


def _remember_orders() -> None:
    """Order the candidates for a function by their target once."""
    order = utils.order_by_target_specificity
    known: dict[tuple[Any, ...], Any] = {}

    @functools.wraps(order)
    def ordered(target: Any, candidates: Any, fnkey: Any = "") -> Any:
        asked = (target, *candidates)
        if asked not in known:
            known[asked] = order(target, candidates, fnkey)
        return known[asked]

    _replace(utils, order_by_target_specificity=ordered)


def _remember_bodies() -> None:
    """Read a function that is written into many others once: they are given copies of it."""
    worker = inline_closurecall.InlineWorker
    read = worker.run_untyped_passes
    known: dict[Any, Any] = {}

    def body(self: Any, function: Any, enable_ssa: bool = False) -> Any:
        asked = (function, enable_ssa)
        if asked not in known:
            known[asked] = read(self, function, enable_ssa)
        self.flags.enable_ssa = enable_ssa  # as what reads it leaves them
        return known[asked]

    _replace(worker, run_untyped_passes=body)


def _refresh_seldom() -> None:
    """Look for new functions of numba's where modules were imported or something was registered,
    not before each function that is compiled and after each that is not found: a thirtieth."""
    for context in (cpu_target.typing_context, cpu_target.target_context):
        _replace(context, refresh=_only_then(context))


def _only_then(context: Any) -> Callable[[], None]:
    refresh = context.refresh
    registered: list[Any] = []
    seen: list[int] = []

    def state() -> list[int]:
        return [len(sys.modules), *map(len, registered)]

    def refreshed() -> None:
        if state() == seen:
            return
        refresh()
        loaders = context._registries.items()
        registered[:] = [
            getattr(registry, name)
            for registry, loader in loaders
            for name in loader.registry_items
        ]
        seen[:] = state()

    return refreshed


def _skip_what_lives() -> None:
    """Find out which variables live at the beginning of each block for generators only: a tenth.

    Numba does so after each step of its compiler, for them and for code that it does not compile.
    """
    processor = postproc.PostProcessor
    run, canonical = processor.run, postproc.transforms.canonicalize_cfg
    lifetimes = postproc.VariableLifetime

    def run_briefly(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        given = self.func_ir
        if given.is_generator:
            run(self, emit_dels, extend_lifetimes)
            return
        given.blocks = canonical(given.blocks)
        given.variable_lifetime = lifetimes(given.blocks)
        given.generator_info = None
        if emit_dels:
            self._insert_var_dels(extend_lifetimes=extend_lifetimes)

    _replace(processor, run=run_briefly)


def _list_variables() -> None:
    """List the variables of a statement without asking each of its parts for all its kinds."""
    others = ir.Inst._rec_list_vars
    nothing = {ir.Loc, str, int, float, bool, type(None), type, *map(type, _OPERATORS)}
    containers = (list, tuple)

    def listed(self: Any, given: Any) -> list[Any]:
        kind = type(given)
        if kind is dict:
            given = given.values()
        elif kind not in containers:
            found: list[Any] = others(self, given)
            return found
        found = []
        for part in given:
            kind = type(part)
            if kind is ir.Var:
                found.append(part)
            elif kind not in nothing:
                found += listed(self, part)
        return found

    _replace(ir.Inst, _rec_list_vars=listed)


def _copy_no_places() -> None:
    """Leave places in files, which nobody changes, as they are where code is copied."""
    _replace(ir.Loc, __deepcopy__=lambda self, _: self)


def _tell_no_types() -> None:
    """Keep no listing of each kernel's lines with the types of what is in them."""
    _replace(TypeAnnotation, __str__=lambda _: "")


def _look_for_what_is_counted() -> None:
    """Take those parts out of arrays and tuples that can hold a reference.

    Numba takes out each number of each array in a tuple to find that it holds none, wherever one is
    counted: an eighth of all it writes for LLVM.
    """
    known: dict[Any, bool] = {}

    def is_counted(model: Any, models: Any, builder: Any) -> bool:
        kind = model.fe_type
        if kind not in known:
            known[kind] = model.has_nrt_meminfo() or any(
                is_counted(models[part], models, builder) for part, _ in model.traverse(builder)
            )
        return known[kind]

    def counted(self: Any, builder: Any, kind: Any, value: Any) -> list[Any]:
        models = self._context.data_model_manager
        model = models[kind]
        found = []
        if model.has_nrt_meminfo():
            found.append((kind, model.get_nrt_meminfo(builder, value)))
        for part, taken_from in model.traverse(builder):
            if is_counted(models[part], models, builder):
                found += self.get_meminfos(builder, part, taken_from(value))
        return found

    _replace(NRTContext, get_meminfos=counted)


def _take_what_was_put_in() -> None:
    """Have LLVM not take a part out of a tuple that has just been put into it."""
    take = IRBuilder.extract_value

    def taken(self: Any, tuple_: Any, index: Any, name: str = "") -> Any:
        if isinstance(index, int):
            while type(tuple_) is instructions.InsertValue and len(tuple_.indices) == 1:
                if tuple_.indices[0] == index:
                    return tuple_.operands[1]
                tuple_ = tuple_.operands[0]
        return take(self, tuple_, index, name)

    _replace(IRBuilder, extract_value=taken)


def _index_values() -> None:
    """Take shape and data for an index out of the array as it is, once.

    Numba writes the array to memory and reads each number from there, twice.
    """
    make, put, index = (
        cgutils._StructProxy.__init__,
        cgutils._StructProxy.__setitem__,
        arrayobj.basic_indexing,
    )

    def made(self: Any, context: Any, builder: Any, value: Any = None, ref: Any = None) -> None:
        given = value if ref is None else None
        if given is not None:  # nobody reads what is there before it
            with builder.goto_entry_block():
                ref = builder.alloca(given.type)
        make(self, context, builder, value, ref)
        self._given = given if self._value is self._outer_ref else None

    def put_in(self: Any, position: Any, value: Any) -> None:
        self._given = None
        put(self, position, value)

    @functools.wraps(index)
    def indexed(context: Any, builder: Any, kind: Any, array: Any, *args: Any, **kws: Any) -> Any:
        return index(context, builder, kind, _Read(array, builder), *args, **kws)

    _replace(cgutils._StructProxy, __init__=made, __setitem__=put_in)
    _replace(arrayobj, basic_indexing=indexed)


class _Read:
    """An array that is only read, while nobody writes to it."""

    def __init__(self, array: Any, builder: Any) -> None:
        self._array = array
        self._builder = builder

    def __getattr__(self, name: str) -> Any:
        given = vars(self._array).get("_given")
        if given is None or not isinstance(self._array, cgutils.ValueStructProxy):
            found = getattr(self._array, name)
        else:
            position = self._array._datamodel.get_field_position(name)
            found = self._builder.extract_value(given, position)
        setattr(self, name, found)
        return found


SHORTCUTS = (
    _remember_operators,
    _remember_orders,
    _remember_bodies,
    _refresh_seldom,
    _skip_what_lives,
    _list_variables,
    _copy_no_places,
    _tell_no_types,
    _look_for_what_is_counted,
    _take_what_was_put_in,
    _index_values,
)
"""What is left out, one by one."""
