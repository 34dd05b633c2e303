"""The evaluation's cases as problems, each made once in a process: tests only look at them."""

from functools import lru_cache

import numpy as np

from benchmarks.cases import make_problem


@lru_cache(maxsize=24)
def problem_of(case, seed=0):
    """Problem and objective of a case, whose clouds have that seed's noise."""
    return make_problem(case, np.random.default_rng(seed))
