"""ROS domains that runs of the tests do not share, be they of one machine or one run."""

import fcntl
import os
import tempfile
from pathlib import Path

HIGHEST = 101
"""Above it the ports that a domain uses may be taken by others on Linux."""
_CLAIMED = []
"""Open files, whose locks end with this process."""


def claimed_domain() -> str:
    """The number of a domain that is no other's as long as this process lives."""
    for step in range(HIGHEST):
        number = 1 + (os.getpid() + step) % HIGHEST
        file = (Path(tempfile.gettempdir()) / f"test_ros_domain_{number}").open("a")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            continue
        _CLAIMED.append(file)
        return str(number)
    raise RuntimeError(f"all {HIGHEST} ROS domains are taken by tests that run at the moment")
