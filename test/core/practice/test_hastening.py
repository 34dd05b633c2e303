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


def test_operators_that_were_looked_up_once_are_those_that_numba_finds():
    clean = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    ended = subprocess.run(
        [sys.executable, "-c", TYPED_ALIKE], capture_output=True, text=True, env=clean
    )
    assert ended.stdout.strip() == "3", ended.stderr
