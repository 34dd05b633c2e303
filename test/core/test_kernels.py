"""How kernels are compiled and kept: without counts where lean, apart by state, and unnoticed."""

import ast
import importlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from numba.core.options import DefaultOptions

import placement_planner_ros
from placement_planner_ros.core import disk_cache, kernel_cache, kernel_compiler, kernels

PACKAGE = Path(placement_planner_ros.__file__).parent
WITH_KERNELS = [
    file for file in sorted(PACKAGE.rglob("*.py")) if "@kernel(" in file.read_text(encoding="utf-8")
]
MODULES = [
    ".".join((PACKAGE.name, *file.relative_to(PACKAGE).with_suffix("").parts))
    for file in WITH_KERNELS
]


class Pair(NamedTuple):
    a: np.ndarray
    b: np.ndarray


@numba.njit(inline="never")
def _sum_of(pair):
    total = 0.0
    for k in range(pair.a.shape[0]):
        total += pair.a[k] * pair.b[k]
    return total


def total(pairs, times):
    result = 0.0
    for _ in range(times):
        result += _sum_of(pairs[0]) - _sum_of(pairs[1])
    return result


def counts(function) -> int:
    """How often the compiled function touches a reference count."""
    pairs = (Pair(np.ones(3), np.ones(3)), Pair(np.ones(3), np.zeros(3)))
    assert function(pairs, 2) == 6.0
    return sum("NRT_incref" in code for code in function.inspect_llvm().values())


def test_numba_still_knows_the_undocumented_option_that_makes_kernels_lean():
    """Where this fails, numba has dropped `_nrt`: kernels work as before, but are much slower."""
    assert hasattr(DefaultOptions, "_nrt")
    assert kernels.UNCOUNTED == {"_nrt": False}


def test_lean_kernels_count_no_references():
    assert counts(numba.njit(total)) == 1, "what is compared with counts nothing either"
    assert counts(numba.njit(**kernels.UNCOUNTED)(total)) == 0


def run(code: str, **environment: str) -> str:
    clean = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "PYTHONPATH")}
    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        env=clean | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("own", [False, True])
def test_importing_the_package_leaves_where_others_keep_their_kernels(own, tmp_path):
    assert len(MODULES) > 10
    code = (
        "import importlib, numba, os\n"
        "before = numba.config.CACHE_DIR, dict(os.environ)\n"
        f"for name in {MODULES}: importlib.import_module(name)\n"
        "assert (numba.config.CACHE_DIR, dict(os.environ)) == before, numba.config.CACHE_DIR\n"
        "print(repr(before[0]))"
    )
    home = {"XDG_CACHE_HOME": str(tmp_path), "PYTHONPATH": str(PACKAGE.parent)}
    asked = {"NUMBA_CACHE_DIR": str(tmp_path / "asked")} if own else {}
    assert run(code, **home, **asked) == repr(asked.get("NUMBA_CACHE_DIR", ""))


def test_each_kernel_is_kept_in_a_folder_for_the_state_of_its_file():
    made = {
        kernel: Path(kernel.stats.cache_path)
        for name in MODULES
        for kernel in vars(importlib.import_module(name)).values()
        if isinstance(kernel, Dispatcher)
    }
    assert len(made) > 30
    folders = {}
    for kernel, path in made.items():
        file = Path(kernel.py_func.__code__.co_filename)
        state = Path(kernels._cache_folder(str(file)))
        assert state == path
        assert re.fullmatch(rf"{file.stem}-[0-9a-f]{{16}}", state.name)
        folders.setdefault(state, set()).add(file)
    assert all(len(files) == 1 for files in folders.values())


CALLED = """
from placement_planner_ros.core.kernels import kernel

@kernel()
def amount():
    return {amount}
"""
CALLER = """
from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.{module} import (
    {name},
)

@kernel(lean=True)
def {own}():
    return 10 * {name}()
"""


@pytest.fixture
def little_package(tmp_path):
    """outer.py calls caller.py, which calls called.py; beside.py calls nothing."""
    core = tmp_path / "placement_planner_ros" / "core"
    core.mkdir(parents=True)
    for folder in (core, core.parent):
        (folder / "__init__.py").touch()
    for module in (kernels, kernel_cache, kernel_compiler, disk_cache):
        shutil.copy(module.__file__, core)
    (core / "called.py").write_text(CALLED.format(amount=1))
    (core / "caller.py").write_text(CALLER.format(module="called", name="amount", own="ten"))
    (core / "outer.py").write_text(CALLER.format(module="caller", name="ten", own="hundred"))
    (core / "beside.py").write_text(CALLED.format(amount=5))
    return core


def folders_of(core):
    spec = importlib.util.spec_from_file_location("own_kernels", core / "kernels.py")
    own = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(own)
    names = ("called", "caller", "outer", "beside")
    return {name: own._cache_folder(str(core / f"{name}.py")) for name in names}


def test_a_change_of_a_called_file_gives_its_callers_new_folders(little_package):
    before = folders_of(little_package)
    assert len(set(before.values())) == 4
    assert folders_of(little_package) == before
    (little_package / "called.py").write_text(CALLED.format(amount=2))
    after = folders_of(little_package)
    assert {name for name in before if before[name] != after[name]} == {"called", "caller", "outer"}


def test_callers_are_compiled_anew_where_what_they_call_has_changed(little_package, tmp_path):
    code = "from placement_planner_ros.core.outer import hundred; print(hundred())"
    where = {"PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    assert run(code, **where) == "100"
    (little_package / "called.py").write_text(CALLED.format(amount=2))
    assert run(code, **where) == "200"
    assert list((tmp_path / "cache" / "placement_planner_ros").glob("outer-*"))


def test_what_kernels_call_is_imported_in_the_one_form_that_is_looked_for():
    """`from placement_planner_ros.core.x import …`, or a change there would go unnoticed."""
    for file in WITH_KERNELS:
        assert_imports_in_that_form(file)


def assert_imports_in_that_form(file):
    text = file.read_text(encoding="utf-8")
    found = kernels._imported_files(file, {})
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            assert not any(alias.name.startswith(PACKAGE.name) for alias in node.names)
        if isinstance(node, ast.ImportFrom) and node.module.startswith(PACKAGE.name):
            target = PACKAGE.joinpath(*node.module.split(".")[1:])
            inside = [target / f"{alias.name}.py" for alias in node.names]
            for imported in inside if target.is_dir() else [target.with_suffix(".py")]:
                assert imported in found or imported not in WITH_KERNELS, imported
