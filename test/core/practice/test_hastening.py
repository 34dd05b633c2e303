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


def test_operators_that_were_looked_up_once_are_those_that_numba_finds():
    assert _told(TYPED_ALIKE) == "3"


def test_what_it_compiles_does_the_same_and_gives_back_what_it_takes():
    assert _told(RUN_ALIKE) == "alike"


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
