"""Every stage of a search, passed once with this code; who comes later loads what that took."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import scipy

from placement_planner_ros.core import kernel_cache
from placement_planner_ros.core.disk_cache import (
    TROUBLES,
    bypassed_cache,
    cache_folder,
    seal_content,
    unseal_content,
)
from placement_planner_ros.core.kernels import forget_all, version_of_kernels
from placement_planner_ros.core.warmup.known_task import KnownTask

_CORE = Path(__file__).parents[1]
_NAME = kernel_cache.__name__.removesuffix("kernel_cache")


def pass_every_stage(first: Sequence[Callable[[KnownTask], None]] = ()) -> None:
    """Solve the known task, and keep on disk which kernels are there then.

    Args:
        first: as `KnownTask.solve` says.

    Raises:
        WarmupError: a stage was not passed.
    """
    path = _passed_file()  # of the code that was loaded, should it change meanwhile
    with bypassed_cache():
        KnownTask().solve(first)
    if path is not None:
        with contextlib.suppress(OSError):  # the next process solves it too
            kernel_cache.write_whole(
                path, seal_content(kernel_cache.kernel_versions(_NAME), path.name)
            )


def load_passed() -> bool:
    """Load the kernels with which every stage was passed, if that has been kept.

    Where not all of them can be loaded, none is kept any longer, and `TROUBLES` is told.
    """
    path = _passed_file()
    if path is None or not path.is_file():
        return False
    with contextlib.suppress(OSError, ValueError):
        if kernel_cache.load_kernels(unseal_content(path.read_bytes(), path.name)):
            return True
    TROUBLES.note(
        "unloadable", f"the kernels in {path.parent} cannot be loaded; all are compiled anew"
    )
    with contextlib.suppress(OSError):  # then what is damaged is compiled anew
        path.unlink()
        forget_all()
    return False


def _passed_file() -> Path | None:
    """For this version of all that calls kernels, which decides with which arguments it does."""
    folder = cache_folder()
    if folder is None:
        return None
    libraries = (np.__version__, scipy.__version__, pin.__version__, coal.__version__)
    digest = hashlib.sha256(repr((version_of_kernels(), libraries)).encode())
    for path in sorted(_CORE.rglob("*.py")):
        digest.update(path.read_bytes())
    return folder / f"passed-{digest.hexdigest()[:16]}"
