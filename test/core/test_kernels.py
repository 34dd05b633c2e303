"""Where compiled kernels are kept: apart by the state of all of them, and by programs alone."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import placement_planner_ros
from placement_planner_ros.core import disk_cache, kernels

PACKAGE = Path(placement_planner_ros.__file__).parent
MODULES = [
    ".".join((PACKAGE.name, *file.relative_to(PACKAGE).with_suffix("").parts))
    for file in sorted((PACKAGE / "core").rglob("*.py"))
    if kernels.SHAPING.search(file.read_text(encoding="utf-8"))
]
PLACE = (
    "from placement_planner_ros.core.kernels import use_kernel_folder\n"
    "use_kernel_folder()\n"
    "import numba\n"
    "print(numba.config.CACHE_DIR)"
)
CASTS = {"float32", "int64"}
NUMBERS = CASTS | {"acos", "atan2", "cos", "floor", "isfinite", "isnan", "log", "sin", "sqrt"}
NUMBERS |= {"reshape", "searchsorted", "sum"}
"""What kernels may call of numpy and of arrays that makes no array."""
SAYING = "from placement_planner_ros.core.disk_cache import TROUBLES\nTROUBLES.listen(print)\n"


def run(code: str, **environment: str) -> str:
    clean = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "PYTHONPATH")}
    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        env=clean | {"PYTHONPATH": str(PACKAGE.parent)} | environment,
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
    asked = {"NUMBA_CACHE_DIR": str(tmp_path / "asked")} if own else {}
    assert run(code, XDG_CACHE_HOME=str(tmp_path), **asked) == repr(
        asked.get("NUMBA_CACHE_DIR", "")
    )


def test_programs_keep_kernels_below_the_folder_that_is_asked_for(tmp_path):
    home = Path(run(PLACE, XDG_CACHE_HOME=str(tmp_path)))
    assert home.parent == tmp_path / PACKAGE.name
    asked = Path(run(PLACE, NUMBA_CACHE_DIR=str(tmp_path / "asked")))
    assert asked == tmp_path / "asked" / home.name
    begun_by_it = Path(run(PLACE, NUMBA_CACHE_DIR=str(asked)))
    assert begun_by_it == asked


def test_where_nothing_can_be_written_kernels_go_with_the_program_and_that_is_said(tmp_path):
    (tmp_path / "file").write_text("mine")
    said = run(SAYING + PLACE, XDG_CACHE_HOME=str(tmp_path / "file"))
    trouble, place = said.splitlines()
    assert str(tmp_path / "file") in trouble
    assert "XDG_CACHE_HOME" in trouble
    assert not Path(place).exists()
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize("change", ["none", "longer", "shorter", "gone"])
def test_a_folder_that_has_lost_content_is_emptied_and_that_is_said(change, tmp_path):
    saying = f"{SAYING}{PLACE}"
    folder = Path(run(saying, NUMBA_CACHE_DIR=str(tmp_path)))
    file = folder / "module" / "kernel.nbc"
    file.parent.mkdir()
    file.write_bytes(b"content")
    kernels.note_all_kept(folder)
    if change == "gone":
        file.unlink()
    else:
        file.write_bytes({"none": b"content", "longer": b"content more", "shorter": b""}[change])
    *said, place = run(saying, NUMBA_CACHE_DIR=str(tmp_path)).splitlines()
    assert Path(place) == folder
    if change in ("none", "longer"):
        assert not said
        assert kernels.are_all_kept(folder)
    else:
        assert str(folder) in said[0]
        assert list(folder.iterdir()) == []


def test_what_cannot_be_written_is_used(tmp_path):
    folder = Path(run(PLACE, NUMBA_CACHE_DIR=str(tmp_path)))
    kernels.note_all_kept(folder)
    code = (
        "import pathlib, tempfile\n"
        "from placement_planner_ros.core import kernels\n"
        "def refuse(**_): raise PermissionError(13, 'Permission denied')\n"
        "tempfile.TemporaryFile = refuse\n"
        "kernels.use_kernel_folder()\n"
        "folder = kernels.kernel_folder()\n"
        "print(kernels.are_all_kept(folder), folder)"
    )
    kept, aside = run(code, NUMBA_CACHE_DIR=str(tmp_path)).split()
    assert kept == "True"
    assert Path(aside) != folder


CALLED = """
from numba import njit

@njit(cache=True, nogil=True)
def amount():
    return {amount}
"""
CALLER = """
from numba import njit
from placement_planner_ros.core.called import amount

@njit(cache=True, nogil=True)
def ten():
    return 10 * amount()
"""


def test_callers_are_compiled_anew_where_what_they_call_has_changed(tmp_path):
    core = tmp_path / "placement_planner_ros" / "core"
    core.mkdir(parents=True)
    for folder in (core, core.parent):
        (folder / "__init__.py").touch()
    for module in (kernels, disk_cache):
        shutil.copy(module.__file__, core)
    code = PLACE + "\nfrom placement_planner_ros.core.caller import ten; print(ten())"
    where = {"PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    (core / "caller.py").write_text(CALLER)
    (core / "called.py").write_text(CALLED.format(amount=1))
    first, result = run(code, **where).splitlines()
    assert result == "10"
    assert run(code, **where).splitlines() == [first, "10"]
    (core / "called.py").write_text(CALLED.format(amount=2))
    second, result = run(code, **where).splitlines()
    assert result == "20"
    assert first != second


def test_kernels_that_count_no_references_make_no_arrays():
    """Which nobody would free."""
    seen = 0
    for path in PACKAGE.rglob("*.py"):
        for kernel in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            decorators = getattr(kernel, "decorator_list", ())
            if not any("Uncounted" in ast.unparse(each) for each in decorators):
                continue
            seen += 1
            calls = [each.func for each in ast.walk(kernel) if isinstance(each, ast.Call)]
            names = {each.attr for each in calls if isinstance(each, ast.Attribute)}
            assert names <= NUMBERS, f"{path.name}: {kernel.name}: {names - NUMBERS}"
            assert not any(isinstance(each, ast.ListComp | ast.List) for each in ast.walk(kernel))
    assert seen > 50
