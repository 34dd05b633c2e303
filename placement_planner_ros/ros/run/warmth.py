"""The state of compiling: is what a search needs there?"""

from __future__ import annotations

import threading
from typing import Literal


class Warmth(threading.Event):
    """Set once warming up is over, be it that it failed.

    Attributes:
        failure: why it failed; empty where it did not, or is not over.
        progress: how far compiling is; empty where nothing is compiled.
    """

    def __init__(self) -> None:
        super().__init__()
        self.failure = ""
        self.progress = ""

    @property
    def shown(self) -> Literal["true", "false", "failed"]:
        """As `~/status` says it."""
        if not self.is_set():
            return "false"
        return "failed" if self.failure else "true"
