"""The words about an arm: what was derived or assumed, for whoever uses it to judge."""

from __future__ import annotations

from dataclasses import dataclass

from placement_planner_ros.core.errors import listed
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot


@dataclass(frozen=True, slots=True)
class Announcement:
    """An arm as it was understood, in words; '' where there is nothing to say.

    Attributes:
        chain: which joints.
        torso: that it has joints which its controller may not have, and what to do.
        limits: which limits are assumed, and how to state them.
        notes: what of that to tell whoever begins to plan with it.
    """

    chain: str
    torso: str
    limits: str
    notes: tuple[str, ...]


def announce_arm(
    robot: Robot, arm: Arm, *, derived: bool, accelerations: bool = True
) -> Announcement:
    """What there is to know of an arm of this robot.

    Args:
        derived: whether its joints were derived, rather than chosen by `<arm>.joints`.
        accelerations: False: those are given otherwise.
    """
    how = "derived from the URDF" if derived else "as chosen"
    chain = f"arm {arm.name}: {len(arm.joints)} joints, {how}: {', '.join(arm.joints)}"
    torso, limits = _torso(robot, arm) if derived else "", _limits(robot, arm, accelerations)
    # Accelerations of joints that turn are assumed of most robots, which is no news.
    news = any("velocity" in robot.assumed[joint] for joint in arm.joints) or any(
        robot.assumed[joint] for joint in robot.prismatic.intersection(arm.joints)
    )
    notes = tuple(words for words in (torso, limits if news else "") if words)
    return Announcement(chain, torso, limits, notes)


def _torso(robot: Robot, arm: Arm) -> str:
    """Which joints move other parts of the robot too, as a torso does."""
    # What each joint carries beside the arm and its hand.
    model = robot.model
    ids = [model.getJointId(joint) for joint in arm.joints]
    below = [set(model.subtrees[i]) for i in ids]
    shared = {}
    for joint, carried, low, high in zip(arm.joints, below, arm.lower, arm.upper, strict=True):
        others = [str(model.names[i]) for i in sorted(carried - below[-1] - set(ids))]
        moved = [name for name in others if name not in robot.mimics]
        if moved:
            reach = f" ({low:g} to {high:g} {robot.unit(joint)})"
            reach = "" if joint in arm.continuous else reach
            shared[joint] = f"{joint}{reach}, which moves {listed(moved)} too"
    if not shared:
        return ""
    alone = ", ".join(joint for joint in arm.joints if joint not in shared)
    return (
        f"arm {arm.name} plans with {'; '.join(shared.values())}: its trajectories need "
        f"a controller of all {len(arm.joints)} joints, often a second one beside the arm's; "
        f"to leave {'it' if len(shared) == 1 else 'them'} where the robot stands, set "
        f"{arm.name}.joints: [{alone}]"
    )


def _limits(robot: Robot, arm: Arm, accelerations: bool) -> str:
    """Which limits are assumed, joints with the same limit together."""
    values = {"velocity": (arm.velocity, "s"), "acceleration": (arm.acceleration, "s^2")}
    found: dict[str, list[str]] = {}
    for k, joint in enumerate(arm.joints):
        for what in robot.assumed[joint]:
            if accelerations or what == "velocity":
                limit, time = values[what]
                words = f"{what} limit {limit[k]:g} {robot.unit(joint)}/{time}"
                found.setdefault(words, []).append(joint)
    if not found:
        return ""
    said = " and the ".join(f"{limit} of {listed(joints)}" for limit, joints in found.items())
    return (
        f"arm {arm.name}: nobody states the {said}, so they are assumed; "
        "give MoveIt's joint_limits.yaml as `joint_limits`, or set "
        "acceleration_limits"
    )
