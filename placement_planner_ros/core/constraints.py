"""Constraints on object poses: x in V, s(x), c_f(x), cheapest first."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.contacts.several import contact_classes
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.objective.weighted import Requirements
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.keep_out import inside
from placement_planner_ros.core.types import LEVEL, Array, Contact, Index, Mask, Slope, Verdict
from placement_planner_ros.core.wishes.settings import TurnSettings
from placement_planner_ros.core.wishes.turns import Turns


class PoseConstraints:
    """V, s(x) and c_f(x) of one body in one environment.

    Args:
        problem: o, the environment and V.
        collision: c_f(x)'s margin, and how far from the contact plane its support may lie.
        footing: by which rule it stands.
        raise_height: the least height from which the body must come straight down, metres.
        turns: how the object shall be turned.
        required: terms that are never below a value.

    Attributes:
        problem: the same; with support by polygon, the foot of the centre of mass is the reference
            point of the body's faces.
        faces: the contact class of these.
        contacts: all contact classes, as one: what its features are is told by their numbers.
        turns: the rules about how the object is turned; None where there are none.
        required: the same, or None.
    """

    def __init__(
        self,
        problem: Problem,
        collision: CollisionSettings,
        footing: SupportSettings,
        raise_height: float,
        turns: TurnSettings | None = None,
        required: Requirements | None = None,
    ) -> None:
        self.turns = None
        if turns is not None and turns.asks:
            self.turns = Turns(turns, problem.body.faces)
        self.faces, self.contacts = contact_classes(problem, footing, collision, self.turns)
        self._body = replace(problem.body, faces=self.faces.faces)
        self.problem = replace(problem, body=self._body)
        self.footing = footing
        self._volume = problem.volume
        self._raise_height = raise_height
        self.required = required
        self._keep_out = problem.environment.keep_out
        self._somewhere = np.array([part.vertices[0] for part in self._body.parts])

    def stable(self, T_world_object: pin.SE3, face: int, slope: Slope = LEVEL) -> bool:
        """s(x): the object stays where it is put; of many poses: `verdicts`."""
        T, feature = T_world_object.homogeneous[None], np.array([face])
        stable = self.contacts.stable(T, feature, slope) & self.contacts.held(T, feature)
        return bool(stable[0])

    def free(
        self, T_world_object: pin.SE3, contact: Contact, raise_height: float | None = None
    ) -> bool:
        """c_f(x), on the whole straight way there, `raise_height` long; of many: `verdicts`."""
        length = self._raise_height if raise_height is None else raise_height
        T, feature = T_world_object.homogeneous[None], np.array([contact.feature])
        if len(self._keep_out) and self._in_a_box(T)[0]:
            return False
        return bool(
            self.contacts.free(T, feature, np.array([contact.height]), length, contact.slope)[0]
        )

    def verdict(self, T_world_object: pin.SE3, contact: Contact) -> Verdict:
        """The first constraint that fails, or FEASIBLE."""
        reference = T_world_object.act(self.contacts.references[contact.feature])
        T, feature = T_world_object.homogeneous[None], np.array([contact.feature])
        slope = np.array([contact.slope])
        return Verdict(self._judged(T, feature, reference[None], slope, np.zeros(1))[0])

    def _in_a_box(self, T: Array) -> Mask:
        """(n,) whether any piece of the body at poses (n, 4, 4) begins in a box to keep out of.

        What meets no side of a box is wholly inside or outside.
        """
        points = self._somewhere @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]
        return np.asarray(inside(points, self._keep_out).any(axis=1))

    def _broken_by(self, T: Array) -> Array:
        """(n,) what poses (n, 4, 4) lack of what is required, infinite where they are turned
        otherwise than asked; 0 where they keep all rules."""
        lacking = np.zeros(len(T))
        if self.turns is not None:
            lacking[~self.turns.kept(T[:, :3, :3])] = math.inf
        rows = np.flatnonzero(lacking == 0.0)
        if self.required is not None and len(rows):
            lacking[rows] = self.required.lacking(T[rows])
        return lacking

    def verdicts(
        self,
        faces: Index,
        contacts: Array,
        angles: Array,
        slopes: Array | None = None,
        lacking: Array | None = None,
    ) -> tuple[Index, Array]:
        """Poses with these reference points, and `verdict` of each.

        Args:
            faces: (n,) features.
            contacts: (n, 3) positions of their reference points.
            angles: (n,) θ, rad.
            slopes: (n, 2) of the planes that they stand on; level unless given.
            lacking: (n,) of zeros, to be told by how much those that break a rule do so, see
                `Requirements.lacking`; infinite where they are turned otherwise than asked.

        Returns:
            (n,) verdicts and (n, 4, 4) poses T_world_object.
        """
        slopes = np.zeros((len(faces), 2)) if slopes is None else slopes
        lacking = np.zeros(len(faces)) if lacking is None else lacking
        T = self.contacts.poses(faces, contacts, angles, slopes)
        return self._judged(T, faces, contacts, slopes, lacking), T

    def _judged(
        self, T: Array, faces: Index, contacts: Array, slopes: Array, lacking: Array
    ) -> Index:
        """(n,) verdicts of poses T (n, 4, 4) with these reference points, see `verdicts`."""
        # In V lie the reference points, and horizontally the centres of mass.
        centers = T[:, :3, :3] @ self._body.center_of_mass + T[:, :3, 3]
        centers[:, 2] = contacts[:, 2]
        inside = self._volume.contains(contacts) & self._volume.contains(centers)
        result = np.full(len(faces), Verdict.OUTSIDE_VOLUME, dtype=np.int64)
        # What stands on planes of one slope is judged together.
        for slope in np.unique(slopes, axis=0) if slopes.any() else np.zeros((1, 2)):
            rows = np.flatnonzero(inside & (slopes == slope).all(axis=1))
            heights = contacts[:, 2] - contacts[:, :2] @ slope
            along = float(slope[0]), float(slope[1])
            self._judge(T, faces, heights, rows, along, result, lacking)
        return result

    def _judge(
        self,
        T: Array,
        faces: Index,
        heights: Array,
        rows: Index,
        slope: Slope,
        result: Index,
        lacking: Array,
    ) -> None:
        """Write the verdicts of those rows of poses T (n, 4, 4) in V that stand on one slope, and
        what they lack of what is asked.

        Args:
            heights: (n,) z of their contact planes at x = y = 0, metres.
        """
        result[rows] = Verdict.UNSTABLE
        stable = rows[self.contacts.stable(T[rows], faces[rows], slope)]
        if len(stable):
            result[stable] = Verdict.COLLIDING
            of_stable = T[stable], faces[stable], heights[stable]
            free = self.contacts.free(*of_stable, self._raise_height, slope)
            if len(self._keep_out):
                free &= ~self._in_a_box(T[stable])
            # Of these, what is left of s(x), and the rules.
            rows = stable[free]
            held = self.contacts.held(T[rows], faces[rows])
            result[rows] = np.where(held, Verdict.FEASIBLE, Verdict.UNSTABLE)
            if self.turns is not None or self.required is not None:
                rows = rows[held]
                lacking[rows] = self._broken_by(T[rows])
                result[rows[lacking[rows] > 0.0]] = Verdict.BREAKS_RULE
