"""Other functions in the place of numba's."""

from typing import Any


def replace(owner: Any, **by: Any) -> None:
    """Put these in the place of what an owner has by those names."""
    for name, made in by.items():
        setattr(owner, name, made)
