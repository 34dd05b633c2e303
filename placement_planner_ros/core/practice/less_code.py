"""What numba need not write for LLVM in a process that does nothing but compile.

LLVM's own first steps take all of this out again; but each instruction that numba writes is made,
told as text, read and looked at, which is half of what compiling takes. What runs in the end is the
same. The names that are replaced are those of one version of numba (`hastening`).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from llvmlite.ir import Constant, IRBuilder, instructions
from numba.core import callconv, cgutils, ir, lowering, types
from numba.core.analysis import compute_cfg_from_blocks, compute_use_defs, must_use_alloca
from numba.core.codegen import CPUCodeLibrary
from numba.core.registry import cpu_target
from numba.core.runtime.context import NRTContext
from numba.core.unsafe import eh
from numba.cpython import slicing

from placement_planner_ros.core.practice.replacing import replace
from placement_planner_ros.core.practice.structures import (
    index_with_what_it_takes,
    keep_structures_as_values,
    make_arrays_once,
)

_COUNTED: dict[Any, bool] = {}
"""Of each type, whether it can hold a reference."""


def _is_counted(model: Any, models: Any) -> bool:
    kind = model.fe_type
    if kind not in _COUNTED:
        _COUNTED[kind] = model.has_nrt_meminfo() or any(
            _is_counted(models[part], models) for part, _ in model.traverse(None)
        )
    return _COUNTED[kind]


def _look_for_what_is_counted() -> None:
    """Take those parts out of arrays and tuples that can hold a reference.

    Numba takes out each number of each array in a tuple to find that it holds none, wherever one is
    counted.
    """

    def counted(self: Any, builder: Any, kind: Any, value: Any) -> list[Any]:
        models = self._context.data_model_manager
        model = models[kind]
        found = []
        if model.has_nrt_meminfo():
            found.append((kind, model.get_nrt_meminfo(builder, value)))
        for part, taken_from in model.traverse(builder):
            if _is_counted(models[part], models):
                found += self.get_meminfos(builder, part, taken_from(value))
        return found

    replace(NRTContext, get_meminfos=counted)


def _take_what_was_put_in() -> None:
    """Have LLVM not take a part out of a tuple that has just been put into it."""
    take = IRBuilder.extract_value

    def taken(self: Any, tuple_: Any, index: Any, name: str = "") -> Any:
        at = index[0] if isinstance(index, list) and len(index) == 1 else index
        if isinstance(at, int):
            while type(tuple_) is instructions.InsertValue and len(tuple_.indices) == 1:
                if tuple_.indices[0] == at:
                    return tuple_.operands[1]
                tuple_ = tuple_.operands[0]
        return take(self, tuple_, index, name)

    replace(IRBuilder, extract_value=taken)


def _reckon_without_nothing() -> None:
    """Neither add 0 nor multiply by 0 or 1, nor ask of a number whether it counts from the end."""
    add, mul, fix = IRBuilder.add, IRBuilder.mul, slicing.fix_index

    def added(self: Any, left: Any, right: Any, *args: Any, **kws: Any) -> Any:
        if _is(right, 0):
            return left
        return right if _is(left, 0) else add(self, left, right, *args, **kws)

    def multiplied(self: Any, left: Any, right: Any, *args: Any, **kws: Any) -> Any:
        if _is(right, 1) or _is(left, 0):
            return left
        return mul(self, left, right, *args, **kws)

    def fixed(builder: Any, index: Any, size: Any) -> Any:
        if type(index) is Constant and type(index.constant) is int:
            return builder.add(index, size) if index.constant < 0 else index
        return fix(builder, index, size)

    replace(IRBuilder, add=added, mul=multiplied)
    replace(slicing, fix_index=fixed)


def _is(value: Any, number: int) -> bool:
    return type(value) is Constant and type(value.constant) is int and value.constant == number


def _keep_variables_as_values() -> None:
    """Give no place in memory to variables that are assigned once, before all that reads them.

    Numba does so for those of one block. What holds references stays where it is.
    """
    find = lowering.Lower._find_singly_assigned_variable
    store, delete = lowering.Lower.storevar, lowering.Lower.delvar

    def is_counted(self: Any, name: str) -> bool:
        models = self.context.data_model_manager
        counted = self.context.enable_nrt and _is_counted(models[self.typeof(name)], models)
        return bool(counted)

    def found(self: Any) -> None:
        find(self)
        if not self.func_ir.func_id.is_generator:
            kept = _assigned_once(self.func_ir.blocks)
            self._singly_assigned_vars |= {name for name in kept if not is_counted(self, name)}

    def stored(self: Any, value: Any, name: str, argidx: Any = None) -> None:
        if name in self._singly_assigned_vars or is_counted(self, name):
            store(self, value, name, argidx)
        else:  # nothing to give back that was there before
            self.builder.store(value, self.getvar(name))

    def deleted(self: Any, name: str) -> None:
        if is_counted(self, name):
            delete(self, name)

    replace(lowering.Lower, _find_singly_assigned_variable=found, storevar=stored, delvar=deleted)


def _assigned_once(blocks: dict[int, Any]) -> set[str]:
    """The variables whose one assignment comes before all that reads them, whatever way is taken.

    Numba writes blocks in the order of their numbers, so that of the one that assigns is less.
    """
    targets: dict[str, list[int]] = {}
    for number, block in blocks.items():
        for assignment in block.find_insts(ir.Assign):
            targets.setdefault(assignment.target.name, []).append(number)
    reading: dict[str, list[int]] = {}
    for number, names in compute_use_defs(blocks).usemap.items():
        for name in names:
            reading.setdefault(name, []).append(number)
    before = compute_cfg_from_blocks(blocks).dominators()
    in_memory = must_use_alloca(blocks)
    return {
        name
        for name, assigned in targets.items()
        if len(assigned) == 1
        and name not in in_memory
        and all(
            assigned[0] < number and assigned[0] in before.get(number, ())
            for number in reading.get(name, ())
        )
    }


def _give_places_quickly() -> None:
    """Put what needs a place in memory into the entry block without ado."""

    def given(
        builder: Any, kind: Any, size: Any = None, name: str = "", zfill: bool = False
    ) -> Any:
        if isinstance(size, int):
            size = Constant(cgutils.intp_t, size)
        block, entry = builder.block, builder.function.entry_basic_block
        if entry.terminator is None:
            builder.position_at_end(entry)
        else:
            builder.position_before(entry.terminator)
        place = builder.alloca(kind, size=size, name=name)
        builder.store(kind(None), place)
        builder.position_at_end(block)
        if zfill:
            builder.store(kind(None), place)
        return place

    replace(cgutils, alloca_once=given)


def _count_up_by_one() -> None:
    """Begin to go through a range whose step is 1 without dividing by it."""
    cpu_target.target_context.refresh()
    begins = cpu_target.target_context._defns["getiter"]
    for place, (given, begin) in enumerate(begins.versions):
        if given and given[0] is types.range_state64_type:
            begins.versions[place] = (given, _beginning(begin))
    begins._cache.clear()


def _beginning(begin: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(begin)
    def begun(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        start, stop, step = (builder.extract_value(args[0], k) for k in range(3))
        if not _is(step, 1):
            return begin(context, builder, signature, args)
        zero = start.type(0)
        there = builder.icmp_signed(">", builder.sub(stop, start), zero)
        iterator = context.make_helper(builder, signature.return_type)
        iterator.iter = cgutils.alloca_once_value(builder, start)
        iterator.stop, iterator.step = stop, step
        left = builder.select(there, builder.sub(stop, start), zero)
        iterator.count = cgutils.alloca_once_value(builder, left)
        return iterator._getvalue()

    return begun


def _ask_how_a_call_ended_once() -> None:
    """After a call ask only whether it failed; look for a `try` only in functions that have one."""
    convention = callconv.CPUCallConv
    begin, look = lowering.Lower.setup_function, convention.check_try_status
    propagate = convention.return_status_propagate

    def set_up(self: Any, description: Any) -> None:
        begin(self, description)
        self.builder.tries = any(
            isinstance(assigned.value, (ir.Global, ir.FreeVar, ir.Const))
            and any(assigned.value.value is called for called in _TRYING)
            for block in self.blocks.values()
            for assigned in block.find_insts(ir.Assign)
        )

    def ended(self: Any, builder: Any, code: Any, excinfoptr: Any) -> Any:
        return _Ended(builder, code, excinfoptr)

    def looked(self: Any, builder: Any) -> Any:
        return look(self, builder) if getattr(builder, "tries", True) else None

    def propagated(self: Any, builder: Any, status: Any) -> None:
        if getattr(builder, "tries", True):
            propagate(self, builder, status)
        else:
            builder.store(status.excinfoptr, self._get_excinfo_argument(builder.function))
            self._return_errcode_raw(builder, status.code)

    replace(lowering.Lower, setup_function=set_up)
    replace(
        convention,
        _get_return_status=ended,
        check_try_status=looked,
        return_status_propagate=propagated,
    )


_TRYING = (eh.mark_try_block, eh.end_try_block, eh.exception_check, eh.exception_match)
"""What a function calls that has a `try`."""


class _Ended:
    """How a call ended; each answer is worked out where it is asked for."""

    def __init__(self, builder: Any, code: Any, excinfoptr: Any) -> None:
        self._builder = builder
        self.code = code
        self.excinfoptr = excinfoptr

    @property
    def is_ok(self) -> Any:
        """With a value or with None."""
        return self._builder.not_(self.is_error)

    @property
    def is_error(self) -> Any:
        """Otherwise."""
        builder = self._builder
        has_value = builder.icmp_signed("==", self.code, callconv.RETCODE_OK)
        return builder.not_(builder.or_(has_value, self.is_none))

    @property
    def is_none(self) -> Any:
        """With None."""
        return self._builder.icmp_signed("==", self.code, callconv.RETCODE_NONE)

    @property
    def is_python_exc(self) -> Any:
        """With an exception that is set already."""
        return self._builder.icmp_signed("==", self.code, callconv.RETCODE_EXC)

    @property
    def is_stop_iteration(self) -> Any:
        """At the end of a generator."""
        return self._builder.icmp_signed("==", self.code, callconv.RETCODE_STOPIT)

    @property
    def is_user_exc(self) -> Any:
        """With an exception of the function's own."""
        return self._builder.icmp_signed(">=", self.code, callconv.RETCODE_USEREXC)


def _write_no_wrappers_for_c() -> None:
    """Nobody calls numba's own functions from C."""
    replace(lowering.BaseLower, create_cfunc_wrapper=lambda self: None)


def _optimize_what_is_there() -> None:
    """Pass over those functions of a module that are not only declared."""

    def optimized(self: Any, module: Any) -> None:
        module.data_layout = self._codegen._data_layout
        for function in module.functions:
            if not function.is_declaration:
                passes, builder = self._codegen._function_pass_manager()
                passes.run(function, builder)

    replace(CPUCodeLibrary, _optimize_functions=optimized)


LESS_CODE = (
    _look_for_what_is_counted,
    _take_what_was_put_in,
    _reckon_without_nothing,
    _keep_variables_as_values,
    _give_places_quickly,
    keep_structures_as_values,
    make_arrays_once,
    index_with_what_it_takes,
    _count_up_by_one,
    _ask_how_a_call_ended_once,
    _write_no_wrappers_for_c,
    _optimize_what_is_there,
)
"""What is left out, one by one."""
