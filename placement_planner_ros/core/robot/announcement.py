"""The words about an arm: what was derived or assumed, for whoever uses it to judge."""

from __future__ import annotations

from placement_planner_ros.core.errors import listed
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.model import Robot


def announce_arm(robot: Robot, arm: Arm, derived: bool, accelerations: bool) -> tuple[str, ...]:
    """What there is to know of an arm of this robot before it plans, in sentences: that it has
    joints which its controller may not have, and which limits are assumed.

    Args:
        derived: whether its joints were derived, rather than chosen by `<arm>.joints`.
        accelerations: False: those are given otherwise.
    """
    torso = _torso(robot, arm) if derived else []
    return (*torso, *_limits(robot, arm, accelerations))


def _torso(robot: Robot, arm: Arm) -> list[str]:
    """Which joints move other parts of the robot too, as a torso does."""
    # What each joint carries beside the arm, its hand, and what follows others.
    model = robot.model
    ids = [model.getJointId(joint) for joint in arm.joints]
    own = {*ids, *model.subtrees[ids[-1]], *map(model.getJointId, robot.mimics)}
    moved = {
        joint: set(model.subtrees[number]) - own
        for joint, number in zip(arm.joints, ids, strict=True)
    }
    shared = [
        f"{joint}, which moves {listed([model.names[i] for i in sorted(others)])} too"
        for joint, others in moved.items()
        if others
    ]
    alone = ", ".join(joint for joint, others in moved.items() if not others)
    words = (
        f"arm {arm.name} plans with {'; '.join(shared)}: its trajectories need a controller of all "
        f"{arm.dof} joints; where another one moves {'it' if len(shared) == 1 else 'them'}, set "
        f"{arm.name}.joints: [{alone}], and {'it stays' if len(shared) == 1 else 'they stay'}"
    )
    return [words] if shared else []


def _limits(robot: Robot, arm: Arm, accelerations: bool) -> list[str]:
    """Which limits are assumed, but for accelerations of joints that turn, which most robots
    lack."""
    rates = [("velocity", arm.velocity, "s"), ("acceleration", arm.acceleration, "s^2")]
    found: dict[str, list[str]] = {}
    for what, limits, time in rates if accelerations else rates[:1]:
        for joint, limit in zip(arm.joints, limits, strict=True):
            slides = joint in robot.prismatic
            if what in robot.assumed[joint] and (slides or what == "velocity"):
                words = f"{what} limit {limit:g} {'m' if slides else 'rad'}/{time}"
                found.setdefault(words, []).append(joint)
    said = " and the ".join(f"{limit} of {listed(joints)}" for limit, joints in found.items())
    remedy = "give MoveIt's joint_limits.yaml as `joint_limits`, or set acceleration_limits"
    words = f"arm {arm.name}: nobody states the {said}, so they are assumed; {remedy}"
    return [words] if found else []
