"""toppra without matplotlib, which it imports for its plots: that takes half a second.

Whoever does plot with toppra gets matplotlib then.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import Any


class _Later(ModuleType):
    """Stands for a module that is imported once something of it is asked for."""

    def __getattr__(self, name: str) -> Any:
        return getattr(importlib.import_module(self.__name__), name)


def _import_toppra() -> None:
    if "matplotlib.pyplot" in sys.modules:
        importlib.import_module("toppra")
        return
    own = {name: _Later(name) for name in ("matplotlib", "matplotlib.pyplot")}
    own["matplotlib"].pyplot = own["matplotlib.pyplot"]  # type: ignore[attr-defined]
    others = {name: sys.modules.get(name) for name in own}
    sys.modules.update(own)
    try:
        importlib.import_module("toppra")
    finally:
        for name, other in others.items():
            if other is None:
                del sys.modules[name]
            else:
                sys.modules[name] = other


_import_toppra()

from toppra.algorithm import TOPPRA  # noqa: E402
from toppra.constraint import (  # noqa: E402
    DiscretizationType,
    JointAccelerationConstraint,
    JointVelocityConstraint,
    LinearConstraint,
)
from toppra.constraint.linear_constraint import canlinear_colloc_to_interpolate  # noqa: E402
from toppra.interpolator import AbstractGeometricPath  # noqa: E402

__all__ = [
    "TOPPRA",
    "AbstractGeometricPath",
    "DiscretizationType",
    "JointAccelerationConstraint",
    "JointVelocityConstraint",
    "LinearConstraint",
    "canlinear_colloc_to_interpolate",
]
