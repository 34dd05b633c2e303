"""The planner as a library: nothing in here knows of ROS.

Compiled kernels are cached in one folder per state of the files that hold any. Numba itself only
notices changes in the file that holds a kernel, not in the kernels it calls from other files, and
would go on using what was compiled from an older version of those.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from numba import __version__ as numba_version
from numba.core import config

_HERE = Path(__file__).parent


def _kernels_digest() -> str:
    digest = hashlib.sha256(numba_version.encode())
    for path in sorted(_HERE.rglob("*.py")):
        source = path.read_bytes()
        if b"njit" in source:
            digest.update(source)
    return digest.hexdigest()[:16]


if not os.environ.get("NUMBA_CACHE_DIR"):
    _cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    setattr(config, "CACHE_DIR", str(_cache / "placement_planner_ros" / _kernels_digest()))  # noqa: B010
