"""Inverse kinematics that leaves one turn open: as if the arm held the object on a turntable.

An arm whose joints move its tip in fewer than six directions brings an object to a place, but not
turned as one likes. So its chain is prolonged by a joint without end stops, about the normal of the
face that the object is to stand on and through the point that is placed:

    T_world_tip(q) · T_tip_face · R_z(-θ) = T_world_face

What is asked of the arm then is the place and the way up, five of six equations; where q meets
them, the face is turned by θ from where it was asked for. Kernels, tolerances and limits are those
of any chain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from placement_planner_ros.core.reach.ik import IKSettings, InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.reach.reach_bound import ReachBound
from placement_planner_ros.core.types import Array

_JOINT = "turntable"
_ENDLESS = 4.0 * np.pi
"""rad, further than a search that begins within half a turn goes."""
_UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
"""Half a turn about x: the turntable's axis is -z of the face."""


def lacks_directions(chain: Chain) -> bool:
    """Whether the joints move the tip in fewer directions than the six that there are."""
    return chain.freedom < 6


class Turntable:
    """Solves for the place and the way up of a face, and says how it is turned there.

    Args:
        chain: the arm.
        T_tip_face: (4, 4) the face of the held object, z along its normal into the object.
        settings: tolerances and effort; the tolerance of the position is that of the face's origin.
    """

    def __init__(self, chain: Chain, T_tip_face: Array, settings: IKSettings) -> None:
        self._ik = InverseKinematics(
            _prolonged_chain(chain, T_tip_face), settings, _face_reach(chain, T_tip_face)
        )

    def reachable(self, T_world_face: Array) -> bool:
        """False where the arm is too short for that place (4, 4), however the face is turned."""
        return bool(self._ik.reachable(T_world_face))

    def solve(self, T_world_face: Array, seeds: Array) -> tuple[Array, Array]:
        """Distinct ways to bring the face to that place and upright, in seed order.

        Args:
            T_world_face: (4, 4).
            seeds: (s, dof + 1) configurations, the face's turn θ last, rad.

        Returns:
            (k, dof) configurations and (k,) θ, rad.
        """
        found = self._ik.solve(T_world_face, seeds)
        return found[:, :-1], found[:, -1]

    def track(self, T_world_face: Array, q: Array) -> tuple[Array, float] | None:
        """q (dof,) continued to where the face is at that place (4, 4) and upright, and θ, rad.

        None where that is not close by.
        """
        way = self._ik.track(T_world_face[None], np.append(q, 0.0))
        return None if way is None else (way[-1, :-1], float(way[-1, -1]))


def _face_reach(chain: Chain, T_tip_face: Array) -> ReachBound:
    """How far the face's origin gets: it keeps its distance from the wrist."""
    arm = ReachBound.of(chain)
    beyond_wrist = float(np.linalg.norm(T_tip_face[:3, 3] - arm.wrist))
    return ReachBound(arm.shoulder, np.zeros(3), arm.length + beyond_wrist)


def _prolonged_chain(chain: Chain, T_tip_face: Array) -> Chain:
    """The chain with the turntable as its last joint and the face as its tip."""
    # The turntable at the face, its axis against the normal.
    fixed = np.concatenate([chain.fixed, _UPSIDE_DOWN[None]])
    fixed[-2] = chain.fixed[-1] @ T_tip_face @ _UPSIDE_DOWN
    return replace(
        chain,
        joints=(*chain.joints, _JOINT),
        fixed=fixed,
        prismatic=np.append(chain.prismatic, False),
        lower=np.append(chain.lower, -_ENDLESS),
        upper=np.append(chain.upper, _ENDLESS),
    )
