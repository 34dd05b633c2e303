"""Child processes of Python import the package that their parent has, wherever they begin."""

import os
import site
from pathlib import Path

_HOME = str(Path(__file__).parents[2])
"""The folder in which the package lies."""


def child_environment() -> dict[str, str]:
    """The environment for `python -m` with a module of this package."""
    # A checkout that is the current folder would be imported in place of what is installed.
    environment = {**os.environ, "PYTHONSAFEPATH": "1"}
    if _HOME not in site.getsitepackages():
        paths = [_HOME, *filter(None, [os.environ.get("PYTHONPATH")])]
        environment["PYTHONPATH"] = os.pathsep.join(paths)
    return environment
