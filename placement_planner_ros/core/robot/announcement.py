"""The words about an arm: what was derived or assumed, for whoever uses it to judge."""

from __future__ import annotations

from dataclasses import dataclass

from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.joint_limits import Assumed
from placement_planner_ros.core.robot.model import Robot

MAX_NAMED = 2
"""Joints of a list that are named at most."""


@dataclass(frozen=True, slots=True)
class SharedJoint:
    """A joint of an arm that moves other parts of the robot too, as a torso does.

    Attributes:
        name: of the joint.
        lower, upper: its limits.
        unit: of them; '' where it has no end stops.
        moves: joints it carries that are neither the arm's nor the hand's.
    """

    name: str
    lower: float
    upper: float
    unit: str
    moves: tuple[str, ...]

    def __str__(self) -> str:
        reach = f" ({self.lower:g} to {self.upper:g} {self.unit})" if self.unit else ""
        more = len(self.moves) - MAX_NAMED
        named = ", ".join(self.moves[:MAX_NAMED]) + (f" and {more} more" if more > 0 else "")
        return f"{self.name}{reach}, which moves {named} too"


@dataclass(frozen=True, slots=True)
class Announcement:
    """An arm as it was understood.

    Attributes:
        arm: its name.
        joints: root to tip.
        derived: whether they were derived, rather than chosen by `<arm>.joints`.
        shared: those of them that move other parts of the robot too.
        slides: those of them that slide.
        assumed: limits of them that nobody states.
    """

    arm: str
    joints: tuple[str, ...]
    derived: bool
    shared: tuple[SharedJoint, ...]
    slides: tuple[str, ...]
    assumed: tuple[Assumed, ...]

    @property
    def chain(self) -> str:
        """Which joints, in words."""
        how = "derived from the URDF" if self.derived else "as chosen"
        return f"arm {self.arm}: {len(self.joints)} joints, {how}: {', '.join(self.joints)}"

    @property
    def torso(self) -> str:
        """That the arm has joints which its controller may not have, and what to do; '' without."""
        if not self.derived or not self.shared:
            return ""
        others = {joint.name for joint in self.shared}
        alone = ", ".join(joint for joint in self.joints if joint not in others)
        return (
            f"arm {self.arm} plans with {'; '.join(map(str, self.shared))}: its trajectories need "
            f"a controller of all {len(self.joints)} joints, often a second one beside the arm's; "
            f"to leave {'it' if len(others) == 1 else 'them'} where the robot stands, set "
            f"{self.arm}.joints: [{alone}]"
        )

    def limits(self, accelerations: bool = True) -> str:
        """Which limits are assumed, and how to state them; '' where none is.

        Args:
            accelerations: False: those are given otherwise.
        """
        # Joints with the same limit together.
        found: dict[tuple[str, float, str], list[str]] = {}
        for each in self.assumed:
            if accelerations or each.what == "velocity":
                found.setdefault((each.what, each.value, each.unit), []).append(each.joint)
        if not found:
            return ""
        words = [
            f"{what} limit {value:g} {unit} of {_named_or_counted(joints)}"
            for (what, value, unit), joints in found.items()
        ]
        return (
            f"arm {self.arm}: nobody states the {' and the '.join(words)}, so they are assumed; "
            "give MoveIt's joint_limits.yaml as robot_description_planning, or set "
            "acceleration_limits"
        )

    def notes(self, accelerations: bool = True) -> list[str]:
        """What to tell whoever begins to plan with it, one sentence each.

        Args:
            accelerations: as in `limits`.
        """
        odd = any(each.what == "velocity" or each.joint in self.slides for each in self.assumed)
        return [words for words in (self.torso, self.limits(accelerations) if odd else "") if words]


def announce_arm(robot: Robot, arm: Arm, *, derived: bool) -> Announcement:
    """What there is to know of an arm of this robot.

    Args:
        derived: whether its joints were derived.
    """
    model = robot.model
    # What each joint carries beside the arm and its hand.
    ids = [model.getJointId(joint) for joint in arm.joints]
    below = [set(model.subtrees[i]) for i in ids]
    hand = below[-1]
    shared = []
    for k, (joint, carried) in enumerate(zip(arm.joints, below, strict=True)):
        more = carried - hand - set(ids)
        others = [str(model.names[i]) for i in sorted(more)]
        free = tuple(name for name in others if name not in robot.mimics)
        if free:
            shared.append(
                SharedJoint(
                    joint,
                    float(arm.lower[k]),
                    float(arm.upper[k]),
                    "" if joint in arm.continuous else _unit_of(robot, joint),
                    free,
                )
            )
    return Announcement(
        arm.name,
        arm.joints,
        derived,
        tuple(shared),
        tuple(joint for joint in arm.joints if _unit_of(robot, joint) == "m"),
        tuple(each for each in robot.assumed if each.joint in arm.joints),
    )


def _named_or_counted(joints: list[str]) -> str:
    return ", ".join(joints) if len(joints) <= MAX_NAMED else f"{len(joints)} joints"


def _unit_of(robot: Robot, joint: str) -> str:
    kind = robot.model.joints[robot.model.getJointId(joint)].shortname()
    return "m" if "JointModelP" in kind else "rad"
