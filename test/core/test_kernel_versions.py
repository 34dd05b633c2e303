"""Kernels are compiled once for their kinds of arguments, whatever the values."""

import numba
import pytest

from placement_planner_ros.core import kernels


@pytest.fixture
def fresh_cache(monkeypatch, tmp_path):
    kernels._cache_folder.cache_clear()
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    yield
    kernels._cache_folder.cache_clear()


@pytest.mark.usefixtures("fresh_cache")
@pytest.mark.parametrize("lean", [False, True])
def test_constants_and_first_values_of_loops_make_no_versions_of_their_own(lean):
    @kernels.kernel(lean=lean)
    def double(number):
        return 2 * number

    @kernels.kernel(lean=lean)
    def grow(times):
        count = 0
        for _ in range(times):
            count = double(count) + double(1) - double(number=2)
        return count

    assert grow(3) == -14
    assert double.signatures == [(numba.int64,)]


@pytest.mark.usefixtures("fresh_cache")
def test_nothing_is_compiled_for_callers_that_there_are_none_of():
    @kernels.kernel()
    def double(number):
        return 2 * number

    assert double(2) == 4
    compiled = double.overloads[(numba.int64,)]
    names = compiled.library.get_llvm_str()
    assert compiled.fndesc.llvm_cpython_wrapper_name in names
    assert compiled.fndesc.llvm_cfunc_wrapper_name not in names
