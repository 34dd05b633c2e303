"""One placement with its motion, put together from the topics that carry its parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from trajectory_msgs.msg import JointTrajectory

from placement_planner_ros.client.status import Validity

_TERM = "term."


@dataclass(frozen=True, slots=True)
class Solution:
    """A placement of one run. Its `repr` leaves out the trajectories' hundreds of numbers.

    Attributes:
        run: number of the run that found it.
        number: which of the run's solutions it is, from 1 on.
        objective: how good it is.
        arm: which arm holds the object.
        grasp: which of the arm's grasps, from 0 on.
        face: which side of the object comes to stand.
        approach_start: seconds into `trajectory` at which the way down begins.
        search_time: seconds from the start of the run until it was found.
        terms: of a weighted objective, and those that are required, by name and each in its unit.
        pose: of the object where it stands, in the planning frame.
        trajectory: from where the robot was to the placement, for a joint_trajectory_controller.
        retreat_trajectory: from there on with the hand open; None where there is none.
        validity: as it was when this was handed out; `validity` of the client says it of now.
        words: all this for people.
        unseen: share of the way, of arm and object, through space in and around the target volume
            that no sensor looked at; None where no sensor's place is known.
        gap: ξ that can be had at most beyond this one's; None where that is not known.
        contact: how the object rests: its contact class, face or lean.
        leans_on: what it leans on, in words; '' where it stands.
    """

    run: int
    number: int
    objective: float
    arm: str
    grasp: int
    face: int
    approach_start: float
    search_time: float
    terms: Mapping[str, float]
    pose: PoseStamped
    trajectory: JointTrajectory = field(repr=False)
    retreat_trajectory: JointTrajectory | None = field(repr=False)
    validity: Validity
    words: str
    unseen: float | None = None
    gap: float | None = None
    contact: str = "face"
    leans_on: str = ""


def solution_of(
    manifest: DiagnosticArray,
    pose: PoseStamped,
    trajectory: JointTrajectory,
    retreat: JointTrajectory,
    validity: Validity,
) -> Solution:
    """A solution from the manifest, `~/solution`, and the parts with the same key."""
    (status,) = manifest.status
    values = {pair.key: pair.value for pair in status.values}
    # the manifest has each term as `term.<name>`
    terms = {
        name.removeprefix(_TERM): float(value)
        for name, value in values.items()
        if name.startswith(_TERM)
    }
    return Solution(
        int(values["run"]),
        int(values["solution"]),
        float(values["objective"]),
        values["arm"],
        int(values["grasp"]),
        int(values["face"]),
        float(values["approach_start"]),
        float(values["search_time"]),
        MappingProxyType(terms),
        pose,
        trajectory,
        retreat if values["has_retreat"] == "true" else None,
        validity,
        status.message,
        float(values["unseen"]) if "unseen" in values else None,
        float(values["gap"]) if "gap" in values else None,
        values.get("contact", "face"),
        values.get("leans_on", ""),
    )
