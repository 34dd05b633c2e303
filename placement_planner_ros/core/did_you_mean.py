"""The known name that a misspelt one is nearest to."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """The name most like this one, whatever its case and separators; None where none is like it.

    A name without its group, such as `cell_size`, is like the whole.
    """
    forms: dict[str, str] = {}
    for candidate in known:
        for form in (candidate, candidate.rpartition(".")[2]):
            forms.setdefault(_bare_name(form), candidate)
    near = get_close_matches(_bare_name(name), forms, n=1)
    return forms[near[0]] if near else None


def _bare_name(name: str) -> str:
    return "".join(c for c in name.lower() if c.isalnum())
