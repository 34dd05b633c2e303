"""What a measurement was made with."""

from __future__ import annotations

import functools
import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import psutil

import placement_planner_ros
from placement_planner_ros.share import PACKAGE

_PACKAGES = (PACKAGE, "numpy", "scipy", "numba", "pin", "coal", "ompl", "toppra", "trimesh")


def versions() -> dict[str, str]:
    """Package -> version, or "not installed"; `commit`: the state of the sources."""
    found = {"commit": _source_commit(), "python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def machine() -> dict[str, str | int]:
    """Processor, its number of threads, and the operating system."""
    return {
        "processor": _processor_name(),
        "threads": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
    }


def _processor_name() -> str:
    information = Path("/proc/cpuinfo")
    lines = information.read_text(encoding="utf-8").splitlines() if information.exists() else []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or "unknown")


@functools.cache
def _source_commit() -> str:
    """Of the checkout that the package is imported from, marked where files were changed."""
    checkout = Path(placement_planner_ros.__file__).parent.parent
    command = ["git", "-C", str(checkout), "describe", "--always", "--dirty"]
    if not (checkout / ".git").exists():
        return "no checkout"
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "no checkout"


def resident_megabytes(process: int) -> float:
    """Memory of a process by its number, MB."""
    return float(psutil.Process(process).memory_info().rss) / 1e6
