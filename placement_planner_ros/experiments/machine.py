"""What a measurement was made with."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from placement_planner_ros.share import PACKAGE

_PACKAGES = (PACKAGE, "numpy", "scipy", "numba", "pin", "coal", "ompl", "toppra", "trimesh")


def versions() -> dict[str, str]:
    """Package -> version; a checkout that is not installed says so."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def machine() -> dict[str, str | int]:
    """Processor, its number of threads, and the operating system."""
    return {
        "processor": _processor(),
        "threads": os.cpu_count() or 1,
        "system": f"{platform.system()} {platform.machine()}",
    }


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"
