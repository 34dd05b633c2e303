"""Validity of a placement: nothing new in its way, its inputs fresh and the same."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from placement_planner_ros.core.collision.arm import ArmCollision, CollisionSettings
from placement_planner_ros.core.collision.attached_object import AttachedObject, PlacedObject
from placement_planner_ros.core.errors import JointStateError, listed
from placement_planner_ros.core.grasp.hand_opening import with_opening_hand
from placement_planner_ros.core.robot.arm import MovingArm
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.flying_pixels import flying_among
from placement_planner_ros.core.scene.grid import ObstacleSet
from placement_planner_ros.core.swept.space import Stretch, SweptSpace
from placement_planner_ros.core.timing.quintic import positions_at
from placement_planner_ros.core.types import Array, Goal, Placement, Trajectory
from placement_planner_ros.ros.inputs.inputs import Inputs
from placement_planner_ros.ros.inputs.self_filter import Outline, held_outlines
from placement_planner_ros.ros.run.snapshot import Snapshot

SAMPLES_PER_S = 400
"""Of a curve, between which it counts as straight; 50 to 20,000 of each stretch."""


class Way:
    """The way of one placement, to hold points of newer clouds against. Safe to use from several
    threads.

    Args:
        outline: what the robot and the object in its hand fill at the start; None where points of
            them count, too.
    """

    def __init__(self, space: SweptSpace, outline: Outline | None) -> None:
        self._space = space
        self._outline = outline

    def blocked_by(self, points: Array, origin: Array | None) -> str:
        """What of a newer cloud's points (n, 3), planning frame, stands in the way, in words.

        '' where nothing does. Points of the robot and of the object in its hand do not count, as
        the robot still is where it was when the placement was planned; nor do those of what was
        known then, of the surface the object comes to stand on, single ones, and flying pixels.

        Args:
            origin: (3,) where the sensor was; None where that is not known, and flying pixels count
                then.
        """
        # what was known when it was planned is no news
        rows = self._space.news(points)
        if self._outline is not None and len(rows):
            rows = rows[self._outline.outside(points[rows])]
        # what the way sweeps over meets the rest, or does not
        hit = self._space.first_hit(points[rows])
        if hit is not None and origin is not None:  # only now, for it takes longer than all else
            rows = rows[~flying_among(points, origin, rows)]
            hit = self._space.first_hit(points[rows])
        if hit is None:
            return ""
        x, y, z = hit.point
        return (
            f"a newer cloud cuts through it: {hit.body} meets something new "
            f"at ({x:.3f}, {y:.3f}, {z:.3f}) in the {hit.stretch}"
        )


def way_of(snapshot: Snapshot, environment: Environment, placement: Placement) -> Way:
    """The way of a placement that was planned from that snapshot in that environment.

    Checked is what was planned: transit and approach with the object in hand, the object where it
    stands at last, the hand as it opens, and the retreat.

    Raises:
        PlacementPlannerError: the arm cannot hold the object like that.
    """
    goal, settings = placement.goal, snapshot.parameters.planner_settings.collision
    # points for each measured cell: in dense clouds single new ones count for nothing
    density = sum(map(len, snapshot.clouds)) / max(len(environment.measured), 1)
    obstacles = environment.obstacles_of(goal.arm, goal.grasp)[0]
    # the way as it was planned, stretch by stretch
    stretches = _stretches(placement, snapshot, obstacles, settings)
    space = SweptSpace(stretches, obstacles, settings.collision_margin, density)
    return Way(space, _start_outline(snapshot, goal))


def _start_outline(snapshot: Snapshot, goal: Goal) -> Outline | None:
    """What the robot fills at the start with the object in that grasp; None where that counts."""
    parameters, robot, q = snapshot.parameters, snapshot.robot, snapshot.q_start
    if not parameters["self_filter.enabled"]:
        return None
    padding = parameters["self_filter.padding"]
    held = held_outlines(robot, q, [snapshot.arm(goal.arm)], snapshot.body, padding)
    of_robot = Outline.of_robot(robot, q, padding, parameters.padding_of)
    return Outline(of_robot.placed + held[goal.arm, goal.grasp].placed)


def _stretches(
    placement: Placement, snapshot: Snapshot, obstacles: ObstacleSet, settings: CollisionSettings
) -> list[Stretch]:
    goal, robot = placement.goal, snapshot.robot
    arm = snapshot.arm(goal.arm)
    moving = MovingArm(robot, arm, snapshot.q_start)
    holding = ArmCollision(moving, AttachedObject(snapshot.body, goal.grasp), obstacles, settings)
    # on the approach points up to this height do not count: they are the object's support
    contact = goal.contact_height + settings.contact_tolerance
    path, begin = placement.trajectory, placement.approach_start
    stretches = [
        Stretch("transit", holding, _dense(path, 0.0, begin)),
        Stretch("approach", holding, _dense(path, begin, path.duration), contact, goal.slope),
    ]
    # the hand opens where it is, then leaves the object that stands
    if placement.retreat is not None:
        opening = replace(moving, robot=with_opening_hand(robot, arm, moving.q_rest))
        # the object in the hand is nothing that its fingers could meet as they open
        sweeping = ArmCollision(opening, None, obstacles, settings)
        # As `grasp.OpenHand` has it, which is laid out already.
        q_open = robot.with_open_hand(moving.q_rest, arm)
        opened = MovingArm(robot, replace(arm, touch_links=()), q_open)
        standing = PlacedObject(snapshot.body, placement.T_world_object)
        leaving = ArmCollision(opened, standing, obstacles, settings)
        retreat = placement.retreat
        stretches += [
            Stretch("release", sweeping, path.positions[-1:]),
            Stretch("retreat", leaving, _dense(retreat, 0.0, retreat.duration)),
        ]
    return stretches


def _dense(curve: Trajectory, begin: float, end: float) -> Array:
    """(k, dof) the curve from one time to another, as a `Stretch` needs it."""
    number = int(np.clip(SAMPLES_PER_S * (end - begin), 50, 20_000))
    return positions_at(curve, np.linspace(begin, end, number))


def outdated_inputs(snapshot: Snapshot, inputs: Inputs) -> str:
    """Why what a run began with holds no more, apart from what clouds show; '' where it does.

    The same words as long as the reason is the same.
    """
    # what was replaced comes first, as it makes everything else pointless
    if inputs.robot.key != snapshot.robot_key:
        return "the robot was replaced"
    if inputs.object.key != snapshot.object_key:
        return "the object was replaced"
    if inputs.known.changes != snapshot.known_changes:
        return "the known objects are others now"
    parameters, now = snapshot.parameters, time.monotonic()
    timeout = parameters["joint_state_timeout"]
    stale = list(inputs.joints.stale(snapshot.joints, now, timeout))
    if stale:
        return f"joint values of {listed(stale)} are older than joint_state_timeout = {timeout:g} s"
    max_age = parameters["cloud.max_age"]
    if parameters["cloud.mode"] == "latest":
        old = list(inputs.clouds.stale(max_age, now))
        if old:  # be it that newer ones are refused
            return f"clouds on {listed(old)} are older than cloud.max_age = {max_age:g} s"
    return ""


def moved_from_start(snapshot: Snapshot, inputs: Inputs) -> str:
    """Why the robot is no more where a run began; '' where it is, as far as anybody knows."""
    robot, parameters = snapshot.robot, snapshot.parameters
    tolerance = parameters["start_tolerance"]
    try:
        # what is published counts before what is assumed
        q = robot.configuration({**parameters.assumed_joints, **inputs.joints.positions()})
    except JointStateError:
        pass
    else:
        # as at the start: what is barely beyond a limit counts as at it
        q = robot.within_limits(q, parameters["start_limit_tolerance"])
        left = robot.apart(q, snapshot.q_start) > tolerance
        # only joints whose values matter, without those that moved already at the start
        left &= np.isin(robot.joint_names, list(set(snapshot.joints) - set(snapshot.moving)))
        if left.any():
            # The first of them and no distance: words that change as it moves would be told anew.
            joint = robot.joint_names[int(np.argmax(left))]
            return f"the robot has left q_0: {joint} by more than start_tolerance = {tolerance:g}"
    return ""
