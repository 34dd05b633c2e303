"""The check that a hand which has let go can leave on some straight way off the object.

Only the hand and the object are looked at, wherever these come to be. What is refused here no
placement could have: whatever stands around, and whatever the arm does, each way of `OpenHand`
leads a link of the hand through the object, or too close past it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.attached_object import AttachedObject
from placement_planner_ros.core.collision.object_solids import object_overlaps
from placement_planner_ros.core.errors import GraspError
from placement_planner_ros.core.grasp.hand_opening import check_opening
from placement_planner_ros.core.grasp.settings import PARTING_M, GraspSettings, RetreatSettings
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.moving_arm import MovingArm
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.weak_cache import weak_lru_cache

_LEAVING_STEP_M = 1e-3
"""m between the places that are looked at on a way."""

_DISTANCE_ROUNDING_M = 2e-5
"""m by which coal's distances may be off."""

Hindrance = tuple[str, str, float]
"""A direction in words, the link that gets too near to the object first, and how far on, metres."""


def check_letting_go(moving: MovingArm, held: AttachedObject, settings: GraspSettings) -> None:
    """Raise if the hand could not let go of the object wherever it stood: as it opens, or after.

    Raises:
        GraspError: names the grasp, and what opens into the object, stays in it, or meets it on
            the hand's ways off.
    """
    check_opening(moving, held, max(PARTING_M - settings.room, 0.0))
    check_leaving(moving, held, settings)


def check_leaving(moving: MovingArm, held: AttachedObject, settings: GraspSettings) -> None:
    """Raise if the open hand can leave the object by none of the straight ways that are tried.

    Raises:
        GraspError: names the grasp, and what is too near to the object on the ways off it.
    """
    arm = moving.arm
    given = moving.robot, arm, held.grasp, held.body, moving.q_zero.tobytes()
    found = _leaving_hindrances(*given, settings.retreat, settings.room)
    if not found:
        return
    # In words: the first way and the furthest.
    furthest = max(found, key=lambda each: each[2])
    words = (
        f"the open hand can leave the object in none of the {len(found)} directions that are tried"
        f", {settings.room:g} m from it: "
    )
    for (direction, link, way), lead in ((found[0], ""), (furthest, ", and at the furthest ")):
        words += f"{lead}{direction}, where {link} is nearer after {way:.3f} m"
        if furthest == found[0]:
            break
    raise GraspError(
        f"{arm.name}.grasps[{held.grasp}]",
        pin.SE3ToXYZQUAT(arm.grasps[held.grasp]).round(4).tolist(),
        f"{words}; open the hand further (gripper_open), hold the object where the fingers do not "
        "close around it and the hand does not lie in it, check object.scale, or set "
        "require_retreat to false",
    )


@weak_lru_cache("body", maxsize=64)
def _leaving_hindrances(
    robot: Robot,
    arm: Arm,
    grasp: int,
    body: Body,
    q_bytes: bytes,
    settings: RetreatSettings,
    room: float,
) -> tuple[Hindrance, ...]:
    """What stands in the hand's way in each direction; empty where one of them leads off.

    A place on the way counts where a link of the hand is nearer to the object than it may be, and
    none before `PARTING_M`; the environment and the arm are left out. So this is less than
    `OpenHand` asks for.

    Args:
        q_bytes: of (nq,), the arm's joints at zero.
        room: as of `GraspSettings`, metres.
    """
    # The open hand with the object held.
    q = robot.with_open_hand(np.frombuffer(q_bytes), arm)
    data, things = robot.model.createData(), robot.geometry.geometryObjects
    pin.forwardKinematics(robot.model, data, q)
    T_tip, links = robot.link_pose(q, arm.tip_frame), _hand_geometries(robot, arm)
    # pinocchio's own data of the geometry would be of all links and pairs of them
    placed = {i: data.oMi[things[i].parentJoint] * things[i].placement for i in links}
    T_object = T_tip * arm.grasps[grasp]
    overlaps, first = object_overlaps(robot, body), len(robot.geometry_links)
    # Places on a way, and balls around links and solids.
    ways = np.arange(PARTING_M, settings.retreat_distance + _LEAVING_STEP_M, _LEAVING_STEP_M)
    middles = np.array([placed[i].act(overlaps.centers[i]) for i in links]).reshape(-1, 3)
    solids = np.array([T_object.act(center) for center in overlaps.centers[first:]]).reshape(-1, 3)
    reach = overlaps.radii[list(links)][:, None] + overlaps.radii[first:] + room

    def met(direction: Array) -> tuple[str, float] | None:
        """The first link that is too near to the object as the hand goes along a direction (3,)."""
        # To move the object the other way is the same.
        moved = solids - ways[:, None, None] * direction
        apart = np.linalg.norm(middles[:, None] - moved[:, None], axis=3)
        near, first_met, by = apart <= reach, len(ways), ""
        for link, solid in np.argwhere(near.any(axis=0)).tolist():
            step(f"looking whether the hand of arm {arm.name} can leave the object")
            i, j, clear = links[link], first + solid, 0.0
            for row in np.flatnonzero(near[:first_met, link, solid]).tolist():
                if ways[row] < clear:
                    continue
                at = pin.SE3(T_object.rotation, T_object.translation - ways[row] * direction)
                if overlaps.meet(i, j, placed[i], at, max(room - _DISTANCE_ROUNDING_M, 0.0)):
                    first_met, by = row, robot.geometry_links[i]
                    break
                # Nothing comes nearer to the object by more than its way.
                clear = ways[row] + overlaps.solids_gap(i, j, placed[i], at)
                clear -= room + _DISTANCE_ROUNDING_M
        return (by, float(ways[first_met])) if by else None

    found: list[Hindrance] = []
    # The first direction that leads off is enough.
    for words, direction in _leaving_directions(settings, T_tip, T_object, body):
        hindrance = met(direction)
        if hindrance is None:
            return ()
        found.append((words, *hindrance))
    return tuple(found)


def _hand_geometries(robot: Robot, arm: Arm) -> tuple[int, ...]:
    """Geometries that stand still against the tip when the hand is open."""
    tip = robot.model.frames[robot.frame_id(arm.tip_frame)].parentJoint
    carried = []
    # Geometries that hang on the tip's joint without another that moves.
    for i, thing in enumerate(robot.geometry.geometryObjects):
        joint = thing.parentJoint
        while joint > tip:
            joint = robot.model.parents[joint]
        if joint == tip:
            carried.append(i)
    return tuple(carried)


def _leaving_directions(
    settings: RetreatSettings, T_tip: pin.SE3, T_object: pin.SE3, body: Body
) -> Iterator[tuple[str, Array]]:
    """Directions (3,) of the hand's ways off the object, in words and in the frame of T_tip and
    T_object; those in the world for each side that the object can stand on."""
    # Directions given in the tip frame, then those given in the world.
    for direction in settings.tip_directions:
        unit = np.array(direction) / np.linalg.norm(direction)
        named = ", ".join(f"{x:g}" for x in direction)
        yield f"along ({named}) in the tip frame", T_tip.rotation @ unit
    for direction in settings.world_directions:
        unit = np.array(direction) / np.linalg.norm(direction)
        for number, face in enumerate(body.faces):
            R_object_face = face.T_face_object.rotation.T
            named = ", ".join(f"{x:g}" for x in direction)
            words = f"along ({named}) with the object standing on face {number}"
            yield words, T_object.rotation @ R_object_face @ unit
