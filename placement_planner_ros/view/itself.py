"""Tells whether something is what it was at the last look."""

from __future__ import annotations


class Itself:
    """A thing that is the same as nothing but itself, kept: the `id` of one that is gone may be
    that of the next.

    Args:
        thing: what is kept.
    """

    def __init__(self, thing: object) -> None:
        self._thing = thing

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Itself) and self._thing is other._thing

    def __hash__(self) -> int:
        return id(self._thing)
