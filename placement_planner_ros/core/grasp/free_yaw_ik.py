"""Placing with arms whose joints move the tip in fewer than six directions.

Such an arm says itself how the object is turned about the normal of what it stands on: of a pose x
of Ŝ(r, f) it keeps place and face, and the turn becomes the one it can give there.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.reach.seeds import seed_table
from placement_planner_ros.core.reach.turntable import Turntable
from placement_planner_ros.core.types import Array

FIRST_SEEDS = 16
"""Starts of the inverse kinematics beside q_0 that are tried before the others."""


class FreeYawIK:
    """The turns of the object that an arm of few joints can give it, at places asked for.

    Args:
        chain: the arm.
        T_tip_object: the grasp.
        ik: of the same arm; a configuration counts where it solves for the pose that is said with
            it, place, way up and turn, as with any other arm.
    """

    def __init__(self, chain: Chain, T_tip_object: pin.SE3, ik: InverseKinematics) -> None:
        self._chain = chain
        self._T_tip_object = T_tip_object
        self._ik = ik
        self._seeds = seed_table(chain)
        self._turntables: dict[bytes, Turntable] = {}

    def placed(
        self,
        T_world_object: pin.SE3,
        T_face_object: pin.SE3,
        seeds: int,
        rng: np.random.Generator,
        q_start: Array,
    ) -> list[tuple[pin.SE3, Array]]:
        """Poses at that place, on that face, with the configurations (k, dof) that reach each.

        The pose itself where the arm can bring the object to it; else those that differ from it by
        a turn about the normal. Empty where the arm reaches none.

        Args:
            T_face_object: fT_o of the face it stands on.
            seeds: starts of the inverse kinematics beside q_start (dof,).
        """
        # The face's place, if the arm gets there at all.
        turntable = self._turntable(T_face_object)
        T_world_face = T_world_object * T_face_object.inverse()
        place = T_world_face.homogeneous
        if not turntable.reachable(place):
            return []
        starts = np.append(q_start, 0.0)[None]
        # A few seeds first, then the rest.
        for count in (min(seeds, FIRST_SEEDS), seeds - FIRST_SEEDS):
            if count < 1:
                break
            near = self._near(T_world_face, T_face_object, count, rng)
            Q, turns = turntable.solve(place, np.concatenate([starts, near]))
            starts = starts[:0]
            # The pose as it was asked for, wherever the turn was found.
            as_asked = self._ik.solve(self._tip(T_world_object), Q) if len(Q) else Q
            if len(as_asked):
                return [(T_world_object, as_asked)]
            # Else other turns, one at a time, those that are nearly the same left out.
            found: list[tuple[pin.SE3, Array]] = []
            while len(Q):
                x = _turned_face(T_world_face, float(turns[0])) * T_face_object
                reaching = self._ik.solve(self._tip(x), Q)
                if len(reaching):
                    found.append((x, reaching))
                apart = np.remainder(turns - turns[0] + np.pi, 2.0 * np.pi) - np.pi
                other = np.abs(apart) > self._ik.settings.min_difference
                Q, turns = Q[other], turns[other]
            if found:
                return found
        return []

    def follow(
        self, T_world_object: pin.SE3, T_face_object: pin.SE3, q: Array
    ) -> tuple[pin.SE3, Array] | None:
        """`q` (dof,) continued to that pose, or else to that place, and the pose it then is.

        None where neither is close by.
        """
        # The pose as it was asked for.
        as_asked = self._ik.track(self._tip(T_world_object)[None], q)
        if as_asked is not None:
            return T_world_object, as_asked[-1]
        # Else its place, with the turn that the joints give.
        T_world_face = T_world_object * T_face_object.inverse()
        reached = self._turntable(T_face_object).track(T_world_face.homogeneous, q)
        if reached is None:
            return None
        x = _turned_face(T_world_face, reached[1]) * T_face_object
        tracked = self._ik.track(self._tip(x)[None], reached[0])
        return None if tracked is None else (x, tracked[-1])

    def _turntable(self, T_face_object: pin.SE3) -> Turntable:
        """Of a face, made once."""
        key = T_face_object.homogeneous.tobytes()
        if key not in self._turntables:
            T_tip_face = (self._T_tip_object * T_face_object.inverse()).homogeneous
            self._turntables[key] = Turntable(self._chain, T_tip_face, self._ik.settings)
        return self._turntables[key]

    def _near(
        self, T_world_face: pin.SE3, T_face_object: pin.SE3, count: int, rng: np.random.Generator
    ) -> Array:
        """(count, dof + 1) seeds near that place, each in a turn of its own, which is the last."""
        turns = rng.uniform(-math.pi, math.pi, count)
        tips = [self._tip(_turned_face(T_world_face, turn) * T_face_object) for turn in turns]
        return np.column_stack([self._seeds.near(np.array(tips), 1, rng)[:, 0], turns])

    def _tip(self, T_world_object: pin.SE3) -> Array:
        """(4, 4) T_world_tip that brings the object to that pose."""
        return np.asarray((T_world_object * self._T_tip_object.inverse()).homogeneous)


def _turned_face(T_world_face: pin.SE3, turn: float) -> pin.SE3:
    """The face turned about its normal, rad."""
    return T_world_face * pin.SE3(pin.utils.rotate("z", turn), np.zeros(3))
