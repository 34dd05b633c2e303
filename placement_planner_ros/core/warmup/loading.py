"""Every stage of a search passed once, so that all kernels are compiled; and which those were."""

from __future__ import annotations

import functools
import os
import pickle
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

from numba.core.dispatcher import Dispatcher

from placement_planner_ros.core.disk_cache import TROUBLES, bypassed_cache
from placement_planner_ros.core.kernels import kernel_folder
from placement_planner_ros.core.warmup.known_task import STAGES, KnownTask

CORE_PACKAGE = __package__.rpartition(".")[0]


def passed_file() -> Path | None:
    """The file that is there once all kernels were compiled, and says for which arguments; None
    where there is no home."""
    folder = kernel_folder()
    return None if folder is None else folder / "passed"


@functools.cache
def load_kernels() -> None:
    """Load what every stage of a search needs, once in a process; before that was kept, pass all.

    Raises:
        WarmupError: a stage was not passed.
    """
    # Load what was compiled for the arguments that are written down.
    path = passed_file()
    if path is not None and path.is_file():
        for module, name, signatures in pickle.loads(path.read_bytes()):
            for signature in signatures:
                getattr(import_module(module), name).compile(signature)
        return
    # Pass all stages, making all that is on disk.
    with bypassed_cache():
        for stage in STAGES:
            stage(KnownTask())
    keep_passed()


def keep_passed() -> None:
    """Keep which kernels of the core this process has, for the next one to load."""
    path = passed_file()
    if path is None:
        return
    # Kernels and what they were compiled for, moved into place.
    found = [
        (kernel.py_func.__module__, kernel.py_func.__name__, kernel.signatures)
        for kernel in loaded_kernels()
        if kernel.signatures
    ]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as aside:
            aside.write(pickle.dumps(found))
        os.replace(aside.name, path)
    except OSError as error:
        TROUBLES.note("unwritten", f"which kernels there are cannot be kept in {path}: {error}")


def loaded_kernels() -> list[Any]:
    """All kernels of the core's modules that are imported."""
    # Of all modules, each kernel once.
    modules = [
        module for name, module in sys.modules.items() if name.startswith(f"{CORE_PACKAGE}.")
    ]
    found = {
        id(value): value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, Dispatcher)
    }
    return list(found.values())
