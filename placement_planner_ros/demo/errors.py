"""The error that stops the demonstration."""

from __future__ import annotations


class DemoError(Exception):
    """The demonstration did not get through.

    Args:
        what: what happened.
        remedy: what to try.
    """

    def __init__(self, what: str, remedy: str) -> None:
        super().__init__(f"{what}\n  what to try: {remedy}")
