"""The words about an arm: what was derived or assumed, for whoever uses it to judge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from placement_planner_ros.core.errors import listed
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.joint_limits import Assumed
from placement_planner_ros.core.robot.model import Robot


@dataclass(frozen=True, slots=True)
class Announcement:
    """An arm as it was understood.

    Attributes:
        arm: its name.
        joints: root to tip.
        derived: whether they were derived, rather than chosen by `<arm>.joints`.
        shared: of those that move other parts of the robot too, as a torso does, which, in words.
        slides: those of them that slide.
        assumed: limits of them that nobody states.
    """

    arm: str
    joints: tuple[str, ...]
    derived: bool
    shared: Mapping[str, str]
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
        alone = ", ".join(joint for joint in self.joints if joint not in self.shared)
        return (
            f"arm {self.arm} plans with {'; '.join(self.shared.values())}: its trajectories need "
            f"a controller of all {len(self.joints)} joints, often a second one beside the arm's; "
            f"to leave {'it' if len(self.shared) == 1 else 'them'} where the robot stands, set "
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
            f"{what} limit {value:g} {unit} of {listed(joints)}"
            for (what, value, unit), joints in found.items()
        ]
        return (
            f"arm {self.arm}: nobody states the {' and the '.join(words)}, so they are assumed; "
            "give MoveIt's joint_limits.yaml as `joint_limits`, or set "
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
    model, slides = robot.model, tuple(j for j in arm.joints if _unit_of(robot, j) == "m")
    # What each joint carries beside the arm and its hand.
    ids = [model.getJointId(joint) for joint in arm.joints]
    below = [set(model.subtrees[i]) for i in ids]
    shared = {}
    for joint, carried, low, high in zip(arm.joints, below, arm.lower, arm.upper, strict=True):
        others = [str(model.names[i]) for i in sorted(carried - below[-1] - set(ids))]
        moved = [name for name in others if name not in robot.mimics]
        if moved:
            unit = _unit_of(robot, joint)
            reach = "" if joint in arm.continuous else f" ({low:g} to {high:g} {unit})"
            shared[joint] = f"{joint}{reach}, which moves {listed(moved)} too"
    assumed = tuple(each for each in robot.assumed if each.joint in arm.joints)
    return Announcement(arm.name, arm.joints, derived, shared, slides, assumed)


def _unit_of(robot: Robot, joint: str) -> str:
    kind = robot.model.joints[robot.model.getJointId(joint)].shortname()
    return "m" if "JointModelP" in kind else "rad"
