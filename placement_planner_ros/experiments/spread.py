"""Jobs spread over processes by joblib, or over machines by its dask backend."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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
) -> Iterator[Result]:
    """Yield function(job) of every job as they end, in any order.

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
    if scheduler is not None:
        yield from _on_cluster(function, jobs, scheduler)
    elif processes == 1:
        yield from map(function, jobs)
    else:
        try:
            import joblib
        except ImportError as error:
            raise ParameterError("processes", processes, _REMEDY) from error
        with joblib.parallel_config("loky", n_jobs=processes, inner_max_num_threads=1):
            yield from joblib.Parallel(
                return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs"
            )(joblib.delayed(function)(job) for job in jobs)


def _on_cluster(
    function: Callable[[Job], Result], jobs: Sequence[Job], scheduler: str
) -> Iterator[Result]:
    try:
        import joblib
        from dask.distributed import Client
    except ImportError as error:
        raise ParameterError("dask-scheduler", scheduler, _REMEDY) from error
    with Client(scheduler) as client:
        threads = client.nthreads()
        if not threads or max(threads.values()) > 1:
            raise ParameterError(
                "dask-scheduler",
                f"{scheduler}, threads of its workers: {sorted(threads.values())}",
                "start workers with --nthreads 1: kernels and clocks are not to be shared",
            )
        with joblib.parallel_config("dask", n_jobs=len(threads)):
            yield from joblib.Parallel(
                return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs"
            )(joblib.delayed(function)(job) for job in jobs)
