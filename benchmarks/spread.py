"""Jobs spread over processes by joblib, or over machines by its dask backend."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from typing import TypeVar

from placement_planner_ros.core.errors import ParameterError

Job = TypeVar("Job")
Result = TypeVar("Result")

_REMEDY = "needs joblib (and dask[distributed] for a scheduler): install the extra `evaluation`"


def spread(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    processes: int = 1,
    scheduler: str | None = None,
) -> Iterator[tuple[Job, Result]]:
    """Yield every job and function(job) as they end, in any order.

    Args:
        function: of a module, so that other processes can import it.
        processes: on this machine; 1 runs the jobs here.
        scheduler: address of a dask scheduler whose workers, with one thread each, do the work
            instead.

    Raises:
        ParameterError: joblib or dask is missing, or a worker would run several jobs at once.
    """
    if processes < 1:
        raise ParameterError("processes", processes, "must be at least 1")
    if scheduler is None and processes == 1:
        yield from ((job, function(job)) for job in jobs)
        return
    with ExitStack() as stack:
        try:
            import joblib

            if scheduler is not None:
                from dask.distributed import Client
        except ImportError as error:
            field, value = ("processes", processes) if scheduler is None else _named(scheduler)
            raise ParameterError(field, value, _REMEDY) from error
        if scheduler is None:
            stack.enter_context(
                joblib.parallel_config("loky", n_jobs=processes, inner_max_num_threads=1)
            )
        else:
            threads = stack.enter_context(Client(scheduler)).nthreads()
            if not threads or max(threads.values()) > 1:
                raise ParameterError(
                    *_named(f"{scheduler}, threads of its workers: {sorted(threads.values())}"),
                    "start workers with --nthreads 1: kernels and clocks are not to be shared",
                )
            stack.enter_context(joblib.parallel_config("dask", n_jobs=len(threads)))
        yield from joblib.Parallel(
            return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs"
        )(joblib.delayed(_with_job)(function, job) for job in jobs)


def _named(scheduler: str) -> tuple[str, str]:
    return "dask-scheduler", scheduler


def _with_job(function: Callable[[Job], Result], job: Job) -> tuple[Job, Result]:
    return job, function(job)
