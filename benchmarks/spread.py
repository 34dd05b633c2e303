"""Jobs spread over processes by joblib."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import joblib

from placement_planner_ros.core.errors import ParameterError

Job = TypeVar("Job")
Result = TypeVar("Result")


def spread(
    function: Callable[[Job], Result], jobs: Sequence[Job], processes: int = 1
) -> Iterator[tuple[Job, Result]]:
    """Yield every job and function(job) as they end, in any order.

    Args:
        function: of a module, so that other processes can import it.
        processes: on this machine; 1 runs the jobs here.

    Raises:
        ParameterError: there are none.
    """
    if processes < 1:
        raise ParameterError("processes", processes, "must be at least 1")
    if processes == 1:
        yield from ((job, function(job)) for job in jobs)
        return
    with joblib.parallel_config("loky", n_jobs=processes, inner_max_num_threads=1):
        yield from joblib.Parallel(
            return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs"
        )(joblib.delayed(_with_job)(function, job) for job in jobs)


def _with_job(function: Callable[[Job], Result], job: Job) -> tuple[Job, Result]:
    return job, function(job)
