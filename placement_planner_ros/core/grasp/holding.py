"""Reaching a placement with one arm and one grasp: configurations, approach and retreat."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.carry.tilt import TiltConstraint
from placement_planner_ros.core.collision.arm import ArmCollision
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.grasp.free_yaw_ik import FIRST_SEEDS, FreeYawIK
from placement_planner_ros.core.grasp.open_hand import OpenHand
from placement_planner_ros.core.grasp.settings import GraspSettings
from placement_planner_ros.core.grasp.straight_down import (
    UP,
    StraightLines,
    greatest_stray,
    stray_at,
)
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.reach.seeds import seed_table
from placement_planner_ros.core.reach.turntable import lacks_directions
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.types import Array, Contact, Index, Mask, Verdict

_PLANNED_STRAY_SHARE = 0.75
"""Share of `approach_stray` that waypoints use; the rest is for the timed curve."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacingMotion:
    """What the arm does at a placement, up to timing.

    Attributes:
        approach: (k, dof) from the raised pre-placement straight to contact.
        retreat: (m, dof) from contact straight away with the hand open; None without.
        opening: (3,) unit direction of the way back from contact to the raised pre-placement.
    """

    approach: Array
    retreat: Array | None
    opening: tuple[float, float, float]


class Holding:
    """One arm a holding the object in one grasp g, the rest of the robot at rest.

    Args:
        moving: the arm at q_0.
        open_hand: the same arm once it has let go, shared by its grasps.
        aside: those of the obstacles that never are support, as `ArmCollision` has it.

    Attributes:
        moving, held: as given.
        q_start: (dof,) the arm's part of q_0.
        collision: C_free of this arm with the object in this grasp.
        open_hand: the same arm once it has let go.
        tip_slack: m, more than what inverse kinematics leaves open moves any point of a hand.
        require_retreat: whether a placement without release and retreat counts for nothing.
        any_turn: where the arm's joints move its tip in fewer than six directions, so that it says
            how the object is turned: which turns it can give it; else None.
        upright: the limit on the object's tilt; None without.
    """

    def __init__(
        self,
        moving: MovingArm,
        held: AttachedObject,
        obstacles: ObstacleSet,
        open_hand: OpenHand,
        settings: GraspSettings,
        aside: ObstacleSet | None = None,
    ) -> None:
        self.moving = moving
        self.held = held
        self.arm = moving.arm
        self.grasp = held.grasp
        self.q_start = moving.q
        self.chain = Chain.from_robot(moving.robot, moving.arm, moving.q_rest)
        self.require_retreat = settings.require_retreat
        self.collision = ArmCollision(moving, held, obstacles, settings.collision, aside)
        self.open_hand = open_hand
        self._ik = InverseKinematics(self.chain, settings.ik)
        # What it leaves open moves no point within a metre of the tip by more.
        self.tip_slack = settings.ik.position_tolerance + settings.ik.rotation_tolerance
        grasp = self.arm.grasps[held.grasp]
        self._T_object_tip = grasp.inverse()
        self.any_turn = (
            FreeYawIK(self.chain, grasp, self._ik) if lacks_directions(self.chain) else None
        )
        self.upright: TiltConstraint | None = None
        if settings.tilt is not None:
            self.upright = TiltConstraint(self.chain, grasp.rotation, settings.tilt)
        self._seeds = seed_table(self.chain)
        self._settings = settings.approach
        self._reserve = settings.collision.planning_reserve
        self._left = self._reserve + settings.collision.edge_resolution
        # Heights of the waypoints above contact, the least one among them.
        steps = max(1, round(self._settings.approach_distance / self._settings.approach_step))
        heights = np.linspace(0.0, self._settings.approach_distance, steps + 1)[1:]
        self._heights = np.unique(np.append(heights, self._settings.approach_minimum))
        self._stray = settings.collision.approach_stray
        # The box around the object.
        vertices = held.body.vertices
        lower, upper = vertices.min(axis=0), vertices.max(axis=0)
        corners = np.array(list(itertools.product(*zip(lower, upper, strict=True))))
        self._corners = corners  # whatever bounds their strays bounds those of all they hold

    def tip_pose(self, T_world_object: pin.SE3) -> Array:
        """(4, 4) T_world_tip that brings the object to that pose."""
        return np.asarray((T_world_object * self._T_object_tip).homogeneous)

    def object_pose(self, q: Array) -> pin.SE3:
        """O(q)."""
        return pin.SE3(self.chain.forward(q)) * self.arm.grasps[self.grasp]

    def first_verdicts(self, T_world_object: Array, openings: Array) -> Index:
        """(n,) what the tip alone decides at object poses (n, 4, 4), before any inverse kinematics:
        NO_IK where the arm is too short, ARM_COLLIDING or NO_RELEASE where its hand is not free or
        cannot open, NO_APPROACH where it can begin its way nowhere, or FEASIBLE.

        Args:
            openings: (n, 3) unit directions of the ways back.
        """
        if self.any_turn is not None or not len(T_world_object):
            return np.full(len(T_world_object), Verdict.FEASIBLE)
        T_world_tip = T_world_object @ self._T_object_tip.homogeneous
        verdicts = np.where(self._ik.reachable(T_world_tip), Verdict.ARM_COLLIDING, Verdict.NO_IK)
        near = np.flatnonzero(verdicts == Verdict.ARM_COLLIDING)
        free = self.collision.hands_free(
            T_world_tip[near], self.tip_slack, self._reserve, contact=True
        )
        near = near[free]
        verdicts[near] = Verdict.FEASIBLE
        if self.require_retreat:
            opens = self.open_hand.releases_free(T_world_tip[near], self.tip_slack)
            verdicts[near[~opens]] = Verdict.NO_RELEASE
            near = near[opens]
        # Raised to the least of these heights, or to others, hand and object can be left.
        verdicts[near] = Verdict.NO_APPROACH
        for heights in np.split(self._heights, [1]) if len(near) else ():
            T_raised = np.repeat(T_world_tip[None, near], len(heights), axis=0)
            T_raised[..., :3, 3] += heights[:, None, None] * openings[near]
            free = self.collision.hands_free(T_raised.reshape(-1, 4, 4), self.tip_slack, self._left)
            left = free.reshape(len(heights), -1).any(axis=0)
            verdicts[near[left]] = Verdict.FEASIBLE
            near = near[~left]
        return verdicts

    def configurations(
        self, T_world_object: pin.SE3, seeds: int, rng: np.random.Generator
    ) -> Array | Verdict:
        """(k, dof) distinct q with O(q) = x, free at contact, the nearest to q_0 first.

        The first seeds are tried, then the others; where all that they lead to collides, its
        self-motions are swept.

        Args:
            seeds: starts of the inverse kinematics beside q_0.

        Returns:
            k >= 1 configurations, or the verdict that names why there are none.
        """
        T_world_tip = self.tip_pose(T_world_object)
        verdict = Verdict.NO_IK
        own = self.q_start[None]
        # A few seeds first, q_0 among them, then the rest.
        for count in (min(seeds, FIRST_SEEDS), seeds - FIRST_SEEDS):
            if count < 1:
                break
            near = self._seeds.near(T_world_tip[None], count, rng)[0]
            solutions = self._ik.solve(T_world_tip, np.concatenate([own, near]))
            own = own[:0]
            if len(solutions) == 0:
                continue
            verdict = Verdict.ARM_COLLIDING
            # Free solutions, or free ones among the self-motions of all.
            free = self.free_ones(solutions)
            if len(free) == 0:
                free = self.free_ones(self._ik.sweep(T_world_tip, solutions))
            if len(free):
                return free
        return verdict

    def free_ones(self, Q: Array) -> Array:
        """Those of Q (n, dof) that are free with the object resting on its support, the shorter
        way round, the nearest to q_0 first."""
        Q = self.arm.nearest_turns(Q, self.q_start)
        free = Q[self.collision.free_batch(Q, self._reserve, contact=True)]
        return np.asarray(free[np.argsort(np.abs(free - self.q_start).sum(axis=1))])

    def follow(self, T_world_object: pin.SE3, q: Array) -> Array | None:
        """The configuration (dof,) continuing from `q` that brings the object to that pose."""
        tracked = self._ik.track(self.tip_pose(T_world_object)[None], q)
        return None if tracked is None else np.asarray(tracked[-1])

    def may_pass(self, T_world_object: Array) -> Mask:
        """(n,) False where, with the object at (n, 4, 4), it or the hand certainly is not so free
        that edges which begin there can be certified (`can_be_left`)."""
        T_world_tip = T_world_object @ self._T_object_tip.homogeneous
        return self.collision.hands_free(T_world_tip, self.tip_slack, self._left)

    def transit_free(self, a: Array, b: Array) -> bool:
        """Whether a whole straight joint motion is free and keeps the tilt, with what planning
        keeps in reserve."""
        return self._keeps_tilt(a, b) and self.edge_free(a, b)

    def edge_free(self, a: Array, b: Array) -> bool:
        """`transit_free`, the tilt aside."""
        return self.collision.edge_free(a, b, reserve=self._reserve)

    def can_be_left(self, q: Array) -> bool:
        """Whether q (dof,) keeps what planning keeps in reserve, and by so much that edges which
        begin there can be certified with it."""
        return self.collision.can_be_left(q, self._reserve)

    def _keeps_tilt(self, a: Array, b: Array) -> bool:
        return self.upright is None or self.upright.keeps(a, b)

    def timed_free(self, a: Array, b: Array, deviation: Array, contact: bool = False) -> bool:
        """Whether every motion within `deviation` (dof,) of the straight one, joint by joint, is
        free and keeps the tilt, without reserves."""
        if self.upright is not None and not self.upright.keeps_timed(a, b, deviation):
            return False
        return self.collision.edge_free(a, b, contact=contact, deviation=deviation)

    def comes_straight_down(
        self, points: Array, T_world_object: pin.SE3, opening: Array = UP
    ) -> bool:
        """Whether on all of a curve the object is within `approach_stray` of where c_f(x) swept it.

        Args:
            points: (m, 6, dof) Bézier control points of the curve's pieces, from above to rest.
            opening: (3,) unit direction of the way back from rest.
        """
        lines = self._lines(T_world_object, opening)
        return greatest_stray(self.chain, points, lines) <= self._stray

    def _lines(self, T_world_object: pin.SE3, opening: Array) -> StraightLines:
        """The lines on which the corners of the object's box come to rest."""
        # Corners as they are held in the tip's frame, and as they rest in the world.
        T_tip_object = self.arm.grasps[self.grasp]
        held = self._corners @ T_tip_object.rotation.T + T_tip_object.translation
        placed = self._corners @ T_world_object.rotation.T + T_world_object.translation
        return StraightLines(held, placed, opening)

    def placing_motion(
        self, q: Array, T_world_object: pin.SE3, contact: Contact, poses: PoseConstraints
    ) -> PlacingMotion | Verdict:
        """Contact, release, approach and retreat at `q` (dof,) with O(q) = x, cheap checks first.

        Returns:
            The certified motion, or the verdict that names what stood in the way.
        """
        # Contact and release.
        if not self.collision.free(q, self._reserve, contact=True):
            return Verdict.ARM_COLLIDING
        released = self.open_hand.release_free(q)
        if self.require_retreat and not released:
            return Verdict.NO_RELEASE
        # The way down, then the way back.
        opening = poses.contacts.opening(contact.feature)
        approach = self._approach(q, T_world_object, contact, poses, opening)
        if approach is None:
            return Verdict.NO_APPROACH
        retreat = self.open_hand.retreat(q, self.grasp, T_world_object) if released else None
        if self.require_retreat and retreat is None:
            return Verdict.NO_RETREAT
        x, y, z = opening.tolist()
        return PlacingMotion(approach, retreat, (x, y, z))

    def _approach(
        self,
        q: Array,
        T_world_object: pin.SE3,
        contact: Contact,
        poses: PoseConstraints,
        opening: Array,
    ) -> Array | None:
        """(k, dof) the straight way to `q`, raised pre-placement first, as long as there is room;
        None where even the least length is blocked."""
        settings = self._settings
        upward = [q]
        raised: list[Array] = []
        lines = self._lines(T_world_object, opening)
        below = 0.0
        for height in self._heights.tolist():
            # Up to that height the object is free.
            if not poses.free(T_world_object, contact, height + self._stray):
                break
            # The arm follows, and is free where the way may begin.
            way = self._straight_way(upward[-1], T_world_object, lines, (below, height))
            if way is None:
                break
            upward += way
            below = height
            # It counts once it is long enough, and can be left without contact.
            enough = height >= settings.approach_minimum - 1e-9
            if enough and self.can_be_left(upward[-1]):
                raised = list(upward)
        return np.array(raised[::-1]) if raised else None

    def _straight_way(
        self, q: Array, T_world_object: pin.SE3, lines: StraightLines, ends: tuple[float, float]
    ) -> list[Array] | None:
        """Waypoints (dof,) after `q` from one length of the way to another, their edges free.

        Steps on which the object would leave its line, or lean, are halved; None where steps as
        short as `approach_stray` do not help.

        Args:
            ends: metres from contact; `q` is at the first.
        """
        # The next waypoint.
        below, height = ends
        above = pin.SE3(T_world_object)
        above.translation = T_world_object.translation + height * lines.direction
        q_next = self.follow(above, q)
        if q_next is None:
            return None
        # How far the object leaves its line between both, and whether it leans.
        chord = np.linspace(q_next, q, 5)
        strays = stray_at(self.chain, chord, lines)
        if strays <= _PLANNED_STRAY_SHARE * self._stray and self._keeps_tilt(q, q_next):
            is_free = self.collision.edge_free(q, q_next, contact=True, reserve=self._reserve)
            return [q_next] if is_free else None
        if height - below <= self._stray:
            return None
        # Both halves, one after the other.
        middle = 0.5 * (below + height)
        lower = self._straight_way(q, T_world_object, lines, (below, middle))
        if lower is None:
            return None
        rest = middle, height
        upper = self._straight_way(lower[-1], T_world_object, lines, rest)
        return None if upper is None else lower + upper
