"""Five weighted objectives."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.core.wishes.settings import WishSettings

_MIXTURES = {
    "near and clear": {"near": 1.0, "clearance": 0.5},
    "as it was": {"near": 1.0, "turn": 1.0, "clearance": 0.2},
    "low and firm": {"high": -0.5, "stance": 1.0, "clearance": 0.5},
    "at edges and walls": {"edge": -1.0, "aligned": 0.5, "clearance": 0.5},
    "everything": {
        "clearance": 0.5,
        "near": 0.5,
        "turn": 0.2,
        "high": 0.2,
        "edge": 0.5,
        "aligned": 0.2,
        "stance": 0.2,
    },
}
MIXTURES = MappingProxyType(_MIXTURES)
"""Weights of terms by the mixture's name; the sign of clearance is that of the case's objective."""
_PLACE = np.array([0.35, 0.6, 0.0])
"""Where `near_pose` is, as shares of V's extent."""


def wishes(mixture: str, objective: str, volume: TargetVolume) -> WishSettings:
    """A mixture as settings.

    Args:
        objective: of the case: `maximize_clearance` or `minimize_clearance`.
        volume: in which `near_pose` lies, the object as its mesh is.
    """
    weights = dict(MIXTURES[mixture])
    if objective == "minimize_clearance":
        weights["clearance"] *= -1.0
    place = volume.lower + _PLACE * (volume.upper - volume.lower)
    near_pose = (*place.tolist(), 0.0, 0.0, 0.0, 1.0)
    return WishSettings(tuple(weights), tuple(weights.values()), near_pose)
