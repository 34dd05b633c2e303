"""The words about an arm: what was derived or assumed, for whoever uses it to judge."""

from __future__ import annotations

from placement_planner_ros.core.errors import listed
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot


def announce_arm(
    robot: Robot, arm: Arm, *, derived: bool, accelerations: bool = True
) -> tuple[str, ...]:
    """What there is to know of an arm of this robot before it plans, in sentences: that it has
    joints which its controller may not have, and which limits are assumed.

    Args:
        derived: whether its joints were derived, rather than chosen by `<arm>.joints`.
        accelerations: False: those are given otherwise.
    """
    said = _torso(robot, arm) if derived else "", _limits(robot, arm, accelerations)
    return tuple(filter(None, said))


def _torso(robot: Robot, arm: Arm) -> str:
    """Which joints move other parts of the robot too, as a torso does."""
    # What each joint carries beside the arm, its hand, and what follows others.
    model = robot.model
    ids = [model.getJointId(joint) for joint in arm.joints]
    own = {*ids, *model.subtrees[ids[-1]], *map(model.getJointId, robot.mimics)}
    shared = {}
    for joint, number in zip(arm.joints, ids, strict=True):
        if moved := sorted(set(model.subtrees[number]) - own):
            shared[joint] = f"{joint}, which moves {listed([model.names[i] for i in moved])} too"
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
    """Which limits are assumed, joints with the same limit together.

    Accelerations of joints that turn are assumed of most robots, which alone is no news.
    """
    rates = [("velocity", arm.velocity, "s"), ("acceleration", arm.acceleration, "s^2")]
    found: dict[str, list[str]] = {}
    for what, limits, time in rates if accelerations else rates[:1]:
        for joint, limit in zip(arm.joints, limits, strict=True):
            if what in robot.assumed[joint]:
                unit = "m" if joint in robot.prismatic else "rad"
                words = f"{what} limit {limit:g} {unit}/{time}"
                found.setdefault(words, []).append(joint)
    slides = {joint for joints in found.values() for joint in joints} & robot.prismatic
    if not slides and not any(words.startswith("velocity") for words in found):
        return ""
    said = " and the ".join(f"{limit} of {listed(joints)}" for limit, joints in found.items())
    return (
        f"arm {arm.name}: nobody states the {said}, so they are assumed; "
        "give MoveIt's joint_limits.yaml as `joint_limits`, or set "
        "acceleration_limits"
    )
