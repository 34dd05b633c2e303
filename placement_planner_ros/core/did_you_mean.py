"""The known name that a misspelt one is nearest to."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import SequenceMatcher

_LIKENESS_SHARE = 0.6
"""Share of letters that two names have in common where one may be meant by the other."""
_MAX_NAME_LETTERS = 100
"""Letters of a name that are looked at."""


def did_you_mean(name: str, known: Iterable[str]) -> str | None:
    """The name most like this one, whatever its case and separators; None where none is like it.

    A name without its group, such as `cell_size`, is like the whole.
    """
    wanted = _bare_name(name)
    best, most = None, _LIKENESS_SHARE
    for candidate in known:
        for form in {_bare_name(candidate), _bare_name(candidate.rpartition(".")[2])}:
            matcher = SequenceMatcher(None, wanted, form, autojunk=False)
            if matcher.real_quick_ratio() < most or matcher.quick_ratio() < most:
                continue
            ratio = matcher.ratio()
            if ratio > most or (best is None and ratio == most):
                best, most = candidate, ratio
    return best


def _bare_name(name: str) -> str:
    return "".join(c for c in name[:_MAX_NAME_LETTERS].lower() if c.isalnum())
