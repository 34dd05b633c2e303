"""Turns of the object that keep `TurnSettings`: which way is up, which faces the front.

A pose T(R_n R_z(θ), c) · fT_o points a direction d of the object along R_n R_z(θ) d_f. Each of its
coordinates is a + b cos θ + c sin θ, so where a rule begins and ends to hold is solved for exactly.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from placement_planner_ros.core.body.placement_face import PlacementFace
from placement_planner_ros.core.types import FULL_TURN, SINGLE_ROUNDING, Array, Mask, Slope, upright
from placement_planner_ros.core.wishes.settings import TurnSettings

VERTICAL = math.radians(5.0)
"""Nearer than this to the vertical a direction faces nowhere."""

Ranges = tuple[tuple[float, float], ...]
"""Intervals of θ, each from [0, 2π) on and at most a full turn long, that share no turn."""


class Turns:
    """The rules about how the object is turned.

    Args:
        faces: F.
    """

    def __init__(self, settings: TurnSettings, faces: Sequence[PlacementFace]) -> None:
        self.settings = settings
        self._up = _unit_vector(settings.up)
        self._front = _unit_vector(settings.front)
        self._to_face = [face.T_face_object.rotation for face in faces]
        self.ranges = functools.cache(self._ranges)

    def kept(self, rotations: Array) -> Mask:
        """(n,) whether the rules are kept by objects turned by (n, 3, 3)."""
        kept = np.ones(len(rotations), np.bool_)
        # Where `up` points, as an angle from the vertical.
        if self._up is not None:
            x, y, z = (rotations @ self._up).T
            kept &= np.arctan2(np.hypot(x, y), z) <= self.settings.up_tolerance + SINGLE_ROUNDING
        # Where `front` faces, and the azimuth from where it should, at most half a turn; too near
        # to the vertical it faces nowhere.
        if self._front is not None:
            x, y, _ = (rotations @ self._front).T
            azimuth = np.arctan2(y, x) - self.settings.front_direction
            away = np.abs(np.remainder(azimuth + math.pi, FULL_TURN) - math.pi)
            kept &= away <= self.settings.front_tolerance + SINGLE_ROUNDING
            kept &= np.hypot(x, y) >= math.sin(VERTICAL)
        return kept

    def _ranges(self, face: int, slope: Slope) -> Ranges:
        """The angles θ at which an object on that face and a plane of that slope keeps the rules;
        all of them: ((0, 2π),)."""
        to_normal, to_face = upright(slope), self._to_face[face]
        ends: list[float] = []
        # Where `up` leans by just its tolerance.
        if self._up is not None:
            _, _, up = _turned_coordinates(to_normal, to_face @ self._up)
            ends += _angles_of_value(up, math.cos(self.settings.up_tolerance + SINGLE_ROUNDING))
        # Where `front` is off by just its tolerance, or begins to face nowhere.
        if self._front is not None:
            x, y, z = _turned_coordinates(to_normal, to_face @ self._front)
            for sign in (-1.0, 1.0):
                off = sign * (self.settings.front_tolerance + SINGLE_ROUNDING)
                azimuth = self.settings.front_direction + off
                ends += _angles_of_value(math.cos(azimuth) * y - math.sin(azimuth) * x, 0.0)
                ends += _angles_of_value(z, sign * math.cos(VERTICAL))
        return self._kept_between(sorted({0.0, *ends}), to_normal, to_face)

    def _kept_between(self, ends: list[float], to_normal: Array, to_face: Array) -> Ranges:
        """Of the arcs between angles in ascending order, from 0 on, those that keep the rules,
        joined."""
        ends = [*ends, FULL_TURN]
        # Between two ends the rules are kept everywhere or nowhere.
        middles = np.array([0.5 * (a + b) for a, b in itertools.pairwise(ends)])
        turned = Rotation.from_euler("z", middles[:, None]).as_matrix()
        kept = self.kept(to_normal @ turned @ to_face)
        found: list[tuple[float, float]] = []
        for (low, high), keeps in zip(itertools.pairwise(ends), kept.tolist(), strict=True):
            if not keeps:
                continue
            # It continues the arc before, or is another one.
            if found and found[-1][1] == low:
                found[-1] = found[-1][0], high
            else:
                found.append((low, high))
        # The last arc goes on over θ = 0 into the first.
        if len(found) > 1 and found[0][0] == 0.0 and found[-1][1] == FULL_TURN:
            found[-1] = found[-1][0], FULL_TURN + found.pop(0)[1]
        return tuple(found)


def _unit_vector(direction: Sequence[float]) -> Array | None:
    if not direction:
        return None
    array = np.array(direction, dtype=np.float64)
    return np.asarray(array / np.linalg.norm(array))


def _turned_coordinates(to_normal: Array, direction: Array) -> Array:
    """(3, 3) of each coordinate of R_n R_z(θ) d: its constant, and what comes with cos θ and
    sin θ."""
    dx, dy, dz = direction
    # Turned about z in parts, and these tilted with the plane.
    along_cos, along_sin = np.array([dx, dy, 0.0]), np.array([-dy, dx, 0.0])
    constant = np.array([0.0, 0.0, dz])
    return np.asarray(np.stack([constant, along_cos, along_sin]) @ to_normal.T).T


def _angles_of_value(terms: Array, value: float) -> list[float]:
    """The angles in [0, 2π) at which a + b cos θ + c sin θ is that value, of (3,) terms."""
    constant, along_cos, along_sin = terms.tolist()
    # a + r cos(θ - middle) has the value twice, or not at all.
    size = math.hypot(along_cos, along_sin)
    if size < 1e-12 or abs(value - constant) > size:
        return []
    middle = math.atan2(along_sin, along_cos)
    aside = math.acos((value - constant) / size)
    return [(middle - aside) % FULL_TURN, (middle + aside) % FULL_TURN]
