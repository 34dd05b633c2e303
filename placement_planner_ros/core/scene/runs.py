"""Elements of runs: so many that follow one another, from a first one on."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Rows = npt.NDArray[np.int64]


def rows_of_runs(first: Rows, number: Rows) -> Rows:
    """(n,) first[0], first[0] + 1, ..., `number[0]` of them, then those from first[1] on, ...

    Args:
        first, number: (k,).
    """
    behind = number.cumsum()
    return np.arange(number.sum()) + np.repeat(first - behind + number, number)
