"""A process that compiles faster types what it compiles like any other."""

import os
import subprocess
import sys

TYPED_ALIKE = """
import numba, numpy as np
from placement_planner_ros.core.practice.hastening import hasten

def mixed(values, amount):
    total = amount * 0
    for k in range(len(values)):
        if values[k] > amount and k != 2:
            total += values[k] // 2 + amount**2 - k / 3
    return total

def typed():
    made = numba.njit(mixed)
    results = [made(np.arange(5), 1), made(np.arange(5.0), 1), made(np.arange(5.0), 1.5)]
    found = [version.type_annotation.calltypes for version in made.overloads.values()]
    return results, [sorted(map(str, calls.values())) for calls in found]

before = typed()
hasten()
assert typed() == before
assert typed() == before
print(len(before[1]))
"""

RUN_ALIKE = """
import numba, numpy as np
from typing import NamedTuple
from numba.core.registry import cpu_target
from numba.core.runtime import _nrt_python, rtsys
from placement_planner_ros.core.practice.hastening import hasten

rtsys.initialize(cpu_target.target_context)
_nrt_python.memsys_enable_stats()

class Pair(NamedTuple):
    rows: np.ndarray
    wide: tuple

def added(pair, k):
    return pair.rows[k, -1] + pair.wide[0][k]

inlined = numba.njit(inline="always")(added)

def mixed(rows, line, columns):
    made = np.zeros((len(rows), 3))
    pair = Pair(rows, (line, rows))
    for k in range(len(rows)):
        made[k] = rows[k, 1:4]
        made[k, -1] += inlined(pair, k)
        pair = Pair(made, (line, made)) if k == 1 else pair
    made[1:, 0] = columns[0, ::-2][: len(rows) - 1]
    part = made[:, 1]
    part[0] = columns[-1, 2]
    return made, part, [part[-k] for k in range(1, 3)], pair.rows[0].copy()

def run():
    rng = np.random.default_rng(0)
    given = rng.random((4, 5)), rng.random(4), np.asfortranarray(rng.random((3, 9)))
    began = rtsys.get_allocation_stats()
    results, told = numba.njit(mixed)(*given), [np.array(r).tolist() for r in mixed(*given)]
    assert [np.array(r).tolist() for r in results] == told
    del results
    ended = rtsys.get_allocation_stats()
    return told, ended.alloc - began.alloc, ended.free - began.free

before = run()
assert before[1] == before[2] > 0, before
hasten()
assert run() == before, (run(), before)
print("alike")
"""

SAID_IN_BRIEF = """
import numba, numpy as np
from llvmlite.ir import IRBuilder
from typing import NamedTuple
from placement_planner_ros.core.kernels import UNCOUNTED
from placement_planner_ros.core.practice.hastening import hasten

class Rows(NamedTuple):
    values: np.ndarray
    wide: np.ndarray
    count: int

def picked(rows, k):
    if k >= rows.count:
        raise ValueError("too far")
    return rows.values[k, -1] + rows.wide[-k, 0], k * 2

def ranges(rows, n):
    total = 0.0
    for k in range(n):
        if k == 3:
            continue
        for m in range(k, n - 1):
            total += rows.values[m % rows.count, 0] * m
            if m > 4:
                break
    for k in range(n, -n, -3):
        total = total * 1.01 + k
    for k in range(2, 2):
        total += 1e9
    for step in range(1, 3):
        for k in range(0, n, step):
            total += k
    return total

def ways(rows, n):
    first, second = rows, Rows(rows.wide, rows.values, rows.count)
    line = rows.values[0]
    total, last = 0.0, -1
    while last < n:
        last += 1
        if last % 2:
            line = second.values[last % rows.count]
            first, second = second, first
        elif last > 4:
            line = line[::-1]
        total += line[0] * len(line) + first.values[0, 1]
    return total, last, line[-1], second.wide.shape

def fails(rows, n):
    total = 0.0
    for k in range(n):
        value, twice = inner(rows, k)
        total += value * twice
    return total

def mends(rows, n):
    try:
        return fails_inner(rows, n)
    except Exception:
        return -1.0

def writes(rows, n):
    for k in range(1, n):
        rows.values[k % rows.count, k % 2] += rows.wide[k % rows.count, -1] / k
        rows.values[-1, 0] = max(rows.values[-1, 0], rows.wide[0, 0]) - min(k, 2)
    rows.values[0, :2] = rows.wide[1, ::-1][:2]

LEAN = {ranges: UNCOUNTED, ways: UNCOUNTED}
told = []
insert = IRBuilder._insert

def counting(self, instruction):
    told.append(1)
    return insert(self, instruction)

IRBuilder._insert = counting

def flat(result):
    return np.hstack(result) if isinstance(result, tuple) else result

def run():
    global inner, fails_inner
    inner, fails_inner = numba.njit(picked), numba.njit(fails)
    told.clear()
    rng = np.random.default_rng(0)
    rows = Rows(rng.random((4, 3)), rng.random((4, 3)), 4)
    results = []
    for function in (ranges, ways, fails, mends, writes):
        options = LEAN.get(function, {})
        made = numba.njit(function, **options)
        for n in (0, 1, 4, 7):
            try:
                results.append(made(rows, n))
            except ValueError as error:
                results.append(str(error))
            if function in (ranges, ways):
                assert np.allclose(flat(results[-1]), flat(function(rows, n)))
    return results + [rows.values.tolist()], len(told)

before, long = run()
hasten()
after, brief = run()
assert repr(after) == repr(before), (before, after)
assert before.count("too far") == 1 and -1.0 in before, before
assert brief < 0.75 * long, (brief, long)
print("alike")
"""


def test_operators_that_were_looked_up_once_are_those_that_numba_finds():
    assert _told(TYPED_ALIKE) == "3"


def test_what_it_compiles_does_the_same_and_gives_back_what_it_takes():
    assert _told(RUN_ALIKE) == "alike"


def test_what_it_says_in_brief_is_the_same():
    assert _told(SAID_IN_BRIEF) == "alike"


def test_another_numba_is_left_as_it_is():
    as_given = (
        "import numba\nfrom numba.core import ir, postproc\n"
        "from placement_planner_ros.core.practice.hastening import hasten\n"
        "before = postproc.PostProcessor.run, ir.Inst._rec_list_vars\n"
        "numba.__version__ = {version!r}\nhasten()\n"
        "print(before == (postproc.PostProcessor.run, ir.Inst._rec_list_vars))"
    )
    assert _told(as_given.format(version="0.67.1")) == "True"
    assert _told(as_given.format(version="0.68.1")) == "False"


def _told(code):
    """What a process of its own prints."""
    clean = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=clean)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.strip()
