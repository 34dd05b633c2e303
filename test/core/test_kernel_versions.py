"""Kernels are compiled once for their kinds of arguments, whatever the values."""

import numba
import numpy as np
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
    assert double.inner.signatures == [(numba.int64,)]
    assert double.signatures == []


def long(numbers):
    """Too much for its callers to write it into themselves."""
    a, b, c = numbers[0], numbers[1], numbers[2]
    for _ in range(3):
        a, b, c = (a * b - c) / (a + c), (b * c - a) / (b + a), (c * a - b) / (c + b)
        a, b, c = (a * b - c) / (a + c), (b * c - a) / (b + a), (c * a - b) / (c + b)
        a, b, c = (a * b - c) / (a + c), (b * c - a) / (b + a), (c * a - b) / (c + b)
        a, b, c = (a * b - c) / (a + c), (b * c - a) / (b + a), (c * a - b) / (c + b)
        a, b, c = (a * b - c) / (a + c), (b * c - a) / (b + a), (c * a - b) / (c + b)
        a, b, c = (a * b - c) / (a + c), (b * c - a) / (b + a), (c * a - b) / (c + b)
        a, b, c = (a * b - c) / (a + c), (b * c - a) / (b + a), (c * a - b) / (c + b)
        a, b, c = (a * b - c) / (a + c), (b * c - a) / (b + a), (c * a - b) / (c + b)
    return a + b + c


@pytest.mark.usefixtures("fresh_cache")
def test_functions_of_users_may_call_kernels():
    called = kernels.kernel(lean=True)(long)
    numbers = np.array([1.0, 2.0, 4.0])

    @numba.njit
    def halved(numbers):
        return called(numbers) / 2

    assert halved(numbers) == long(numbers) / 2


@pytest.mark.usefixtures("fresh_cache")
def test_kernels_of_others_make_no_other_version_of_the_cores():
    before = kernels.version_of_kernels()

    def double(number):
        return 2 * number

    double.__module__ = "elsewhere.core.numbers"
    kernels.kernel()(double)
    assert kernels.version_of_kernels() == before
