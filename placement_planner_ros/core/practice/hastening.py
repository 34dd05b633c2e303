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
from numba.core import inline_closurecall, ir, ir_utils, postproc, typed_passes, types, utils
from numba.core.annotations.type_annotations import TypeAnnotation
from numba.core.registry import cpu_target

from placement_planner_ros.core.practice.less_code import LESS_CODE
from placement_planner_ros.core.practice.replacing import replace

_WRITTEN_FOR = "0.68."
"""How the versions of numba begin whose functions `SHORTCUTS` stand for."""
_OPERATORS = frozenset(f for f in vars(operator).values() if callable(f))
_PLAIN = (types.Number, types.Boolean, types.Array, types.UniTuple)
"""Kinds of operands that decide alone what one of numba's functions gives for them."""
_NUMBER = "_hash_for_kernels"
"""Where a type keeps its own."""


def hasten() -> None:
    """Compile faster from now on."""
    gc.set_threshold(100_000, 50, 100)  # collecting what the compiler leaves took a tenth
    with contextlib.suppress(AttributeError):
        # What it notes, for those who watch it, around each call of LLVM: a twentieth.
        llvm.ffi.lib._lock._cblist.clear()
    if numba.__version__.startswith(_WRITTEN_FOR):
        for shortcut in SHORTCUTS:
            shortcut()


def _remember_calls() -> None:
    """Look up once what numba's own functions give for operands of these types: an eighth."""
    owner = types.functions.BaseFunction
    resolve = owner.get_call_type
    known: dict[tuple[Any, ...], Any] = {}

    def resolved(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws or not all(isinstance(given, _PLAIN) for given in args):
            return resolve(self, context, args, kws)
        asked = (self, *args)
        if asked not in known:
            known[asked] = resolve(self, context, args, kws)
        return known[asked]

    replace(owner, get_call_type=resolved)


def _remember_types() -> None:
    """Number each type once, and strip tuples of what they are known to hold once."""
    number, strip = types.Type.__hash__, types.containers.BaseAnonymousTuple.__unliteral__
    known: dict[Any, Any] = {}

    def numbered(self: Any) -> int:
        own: dict[str, Any] = vars(self)
        if _NUMBER not in own:
            own[_NUMBER] = number(self)
        return int(own[_NUMBER])

    def same(self: Any, other: Any) -> bool:
        return self is other or (self.__class__ is other.__class__ and self.key == other.key)

    def stripped(self: Any) -> Any:
        if self not in known:
            known[self] = strip(self)
        return known[self]

    replace(types.Type, __hash__=numbered, __eq__=same)
    replace(types.containers.BaseAnonymousTuple, __unliteral__=stripped)


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

    replace(utils, order_by_target_specificity=ordered)


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

    replace(worker, run_untyped_passes=body)


def _refresh_seldom() -> None:
    """Look for new functions of numba's where modules were imported or something was registered,
    not before each function that is compiled and after each that is not found: a thirtieth."""
    for context in (cpu_target.typing_context, cpu_target.target_context):
        replace(context, refresh=_only_then(context))


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

    replace(processor, run=run_briefly)


def _give_nothing_back() -> None:
    """Leave out where each variable ends in kernels that count no references: a fiftieth."""
    check = typed_passes.check_and_legalize_ir

    def checked(func_ir: Any, flags: Any) -> None:
        if flags.nrt or func_ir.is_generator:
            check(func_ir, flags)
            return
        ir_utils.enforce_no_phis(func_ir)
        ir_utils.enforce_no_dels(func_ir)
        postproc.PostProcessor(func_ir).run()

    replace(typed_passes, check_and_legalize_ir=checked)


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

    replace(ir.Inst, _rec_list_vars=listed)


def _copy_no_places() -> None:
    """Leave places in files, which nobody changes, as they are where code is copied."""
    replace(ir.Loc, __deepcopy__=lambda self, _: self)


def _tell_no_types() -> None:
    """Keep no listing of each kernel's lines with the types of what is in them."""
    replace(TypeAnnotation, __str__=lambda _: "")


SHORTCUTS = (
    _remember_calls,
    _remember_types,
    _remember_orders,
    _remember_bodies,
    _refresh_seldom,
    _skip_what_lives,
    _give_nothing_back,
    _list_variables,
    _copy_no_places,
    _tell_no_types,
    *LESS_CODE,
)
"""What is left out, one by one."""
