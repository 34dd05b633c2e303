"""Jobs spread over processes by joblib, or over machines by its dask backend."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TypeVar

from placement_planner_ros.core.errors import ParameterError

Job = TypeVar("Job")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Workers:
    """Who does the work.

    Attributes:
        processes: on this machine; 1 runs the jobs here.
        scheduler: address of a dask scheduler whose workers, with one thread each, do the work
            instead.

    Raises:
        ParameterError: there are none.
    """

    processes: int = 1
    scheduler: str | None = None

    def __post_init__(self) -> None:
        if self.processes < 1:
            raise ParameterError("processes", self.processes, "must be at least 1")


def spread(
    function: Callable[[Job], Result], jobs: Sequence[Job], workers: Workers
) -> Iterator[tuple[Job, Result]]:
    """Yield every job and function(job) as they end, in any order.

    Args:
        function: of a module, so that other processes can import it.

    Raises:
        ParameterError: joblib or dask is missing, or a worker would run several jobs at once.
    """
    if workers == Workers():
        yield from ((job, function(job)) for job in jobs)
        return
    with ExitStack() as stack:
        try:
            import joblib

            if workers.scheduler is None:
                processes = joblib.parallel_config(
                    "loky", n_jobs=workers.processes, inner_max_num_threads=1
                )
            else:
                processes = joblib.parallel_config(
                    "dask", n_jobs=_dask_workers(workers.scheduler, stack)
                )
        except ImportError as error:
            remedy = "needs joblib, a scheduler dask[distributed] too: pip install '.[benchmarks]'"
            raise ParameterError("workers", workers, remedy) from error
        stack.enter_context(processes)
        yield from joblib.Parallel(
            return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs"
        )(joblib.delayed(_with_job)(function, job) for job in jobs)


def _dask_workers(scheduler: str, stack: ExitStack) -> int:
    from dask.distributed import Client

    threads = stack.enter_context(Client(scheduler)).nthreads()
    if not threads or max(threads.values()) > 1:
        raise ParameterError(
            "dask-scheduler",
            f"{scheduler}, threads of its workers: {sorted(threads.values())}",
            "start workers with --nthreads 1: kernels and clocks are not to be shared",
        )
    return len(threads)


def _with_job(function: Callable[[Job], Result], job: Job) -> tuple[Job, Result]:
    return job, function(job)
