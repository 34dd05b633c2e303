"""Places of the files that ship beside the code: urdf, config, launch."""

from __future__ import annotations

import os
from pathlib import Path

PACKAGE = "placement_planner_ros"


def share_path(*parts: str) -> Path:
    """A shipped file or folder, in a checkout (`pip install -e`) as in an install prefix.

    Looks beside the package, then in `share/placement_planner_ros` of the prefix that holds it,
    then in each prefix of AMENT_PREFIX_PATH.

    Raises:
        FileNotFoundError: it is in none of these places.
    """
    package = Path(__file__).resolve().parent
    folders = [package.parent]
    folders += [parent / "share" / PACKAGE for parent in package.parents]
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    folders += [Path(prefix) / "share" / PACKAGE for prefix in prefixes if prefix]
    for folder in folders:
        path = folder.joinpath(*parts)
        if path.exists():
            return path
    raise FileNotFoundError(
        f"{Path(*parts)} of {PACKAGE} is not installed; looked in {', '.join(map(str, folders))}"
    )
