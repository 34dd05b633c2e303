"""The error that a client raises where there is no solution."""

from __future__ import annotations

NO_NODE = "NO_NODE"
"""Nobody offers the node's services, or does so no more."""
NO_ANSWER = "NO_ANSWER"
"""The node is there, but an answer or a result has not come in time."""
WITHDRAWN = "WITHDRAWN"
"""The client was told to withdraw."""
CLIENT_CODES = (NO_NODE, NO_ANSWER, WITHDRAWN)
"""The client's own codes; all others are the node's."""


class PlacementError(Exception):
    """There is no solution, or a command was refused.

    Args:
        code: the node's, or one of `CLIENT_CODES`.
        words: what the node says, a line for each fault.
        run: which run it is about; None where none began.
    """

    def __init__(self, code: str, words: str, run: int | None = None) -> None:
        self.code = code
        self.words = words
        self.run = run
        super().__init__(words if words.startswith(f"{code}: ") else f"{code}: {words}")
