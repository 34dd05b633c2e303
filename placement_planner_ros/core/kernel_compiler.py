"""Compilation by numba of each kernel once, however many others call it.

Numba links what a function calls into it, and optimises and emits all of it again, with a function
of twenty callees twenty times. Here a kernel is compiled once: its callers get it to write it into
themselves where it is short, then call the one that is there. So its name has to be the same in
each process, which numba's, with a number that it counts up, is not.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

_INLINED_INSTRUCTIONS = 500
"""Instructions beside its arguments from which on a kernel is too long to be written into others.
LLVM does so up to some 50, or 260 where it is called in a loop."""

_WRAPPER = "_ZN7cpython"
"""How the names of wrappers for Python begin."""

_NOT_TO_BE_KEPT = "@numba.dynamic.globals.of.kernels = weak_odr global i8 0"
"""What numba does not keep functions with on disk: those of users that call kernels, which in
another process may not be there."""

NAMES: weakref.WeakKeyDictionary[Callable[..., Any], str] = weakref.WeakKeyDictionary()
"""What tells each function that is a kernel from all others, in every process."""

_LONG: weakref.WeakSet[Any] = weakref.WeakSet()
"""Libraries of kernels that are too long to be written into their callers."""


class KernelCompiler(Compiler):
    """Numba's, with libraries and names as kernels need them."""

    def _compile_bytecode(self) -> Any:
        state = self.state
        name = NAMES.get(state.func_id.func)
        if name is not None:
            state.func_id.unique_id = name
            state.library = KernelLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.enable_object_caching()
        return super()._compile_bytecode()


class KernelLibrary(JITCodeLibrary):
    """A kernel's machine code, and what its callers may write into themselves."""

    _unread = b""

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> KernelLibrary:
        """From disk. What callers may write into themselves is only read for one that does."""
        name, _, (code, bitcode, defined) = state
        self = cls(codegen, name)
        self.enable_object_caching()
        self._set_compiled_object(code)
        self._unread = bitcode
        self._finalize_final_module()
        codegen._engine._defined_symbols.update(defined)
        return self

    def serialize_using_object_code(self) -> Any:
        """For the disk: machine code, what callers may write in, and which symbols there are."""
        name, kind, (code, bitcode) = super().serialize_using_object_code()
        module = self._get_module_for_linking()
        symbols = (*module.functions, *module.global_variables)
        defined = [symbol.name for symbol in symbols if not symbol.is_declaration]
        return name, kind, (code, bitcode, defined)

    def _optimize_functions(self, module: Any) -> None:
        """Each by itself, but for the wrapper for Python, which calls one and no more."""
        if not any(f.name.startswith(_WRAPPER) and not f.is_declaration for f in module.functions):
            super()._optimize_functions(module)

    def add_linking_library(self, library: Any) -> None:
        """What the kernel calls."""
        if library in _LONG:
            self._reload_init.update(library._reload_init)
        else:
            super().add_linking_library(library)

    def _get_module_for_linking(self) -> Any:
        if self._unread:
            self._shared_module, self._unread = llvm.parse_bitcode(self._unread), b""
        if self._shared_module is None:
            made = {f.name for f in self._final_module.functions if f.linkage.name == "external"}
            module = super()._get_module_for_linking()
            for function in module.functions:
                if function.name in made and not function.is_declaration:
                    function.linkage = "available_externally"
            module.link_in(llvm.parse_assembly(_NOT_TO_BE_KEPT))
        return self._shared_module

    def _finalize_dynamic_globals(self) -> None:
        """Kernels are kept all the same: their files name what they call."""


def is_long(compiled: Any) -> bool:
    """Whether a kernel is too long to be written into others."""
    module = compiled.library._get_module_for_linking()
    function = module.get_function(compiled.fndesc.llvm_func_name)
    # Instructions are the lines indented by two, which is told faster than asking for each.
    lines = str(function).splitlines()
    instructions = sum(line[:2] == "  " and line[2:3] not in (" ", "]") for line in lines)
    return instructions > _INLINED_INSTRUCTIONS + sum(1 for _ in function.arguments)


def note_long(library: Any) -> None:
    """That kernel is not to be written into others."""
    _LONG.add(library)
