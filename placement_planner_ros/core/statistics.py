"""What a run has done so far, and in words why nothing was found."""

from __future__ import annotations

from dataclasses import dataclass

from placement_planner_ros.core.search.sampler import SampleCount
from placement_planner_ros.core.types import Verdict

_ADVICE = {
    Verdict.OUTSIDE_VOLUME: (
        "the centre of mass lay outside the target volume",
        "enlarge target_volume",
    ),
    Verdict.UNSTABLE: (
        "a vertex of the placement face had no support",
        "look for holes in the measured surface, or choose a volume with larger surfaces",
    ),
    Verdict.COLLIDING: (
        "the object met obstacles at rest or on its way down",
        "clear some space, or lower collision_margin",
    ),
    Verdict.NOT_BETTER: (
        "the objective did not improve",
        "this is what a search near its optimum looks like",
    ),
    Verdict.NO_IK: (
        "no arm reaches the pose within its joint limits",
        "move target_volume closer, or give further grasps",
    ),
    Verdict.ARM_COLLIDING: (
        "arm, hand or object were in collision at the pose",
        "give grasps that keep the hand away from the support, or clear some space",
    ),
    Verdict.NO_RELEASE: (
        "the fingers could not open without meeting something",
        "give grasps that keep the fingers away from the support, or a smaller gripper_open",
    ),
    Verdict.NO_APPROACH: (
        "no straight way down onto the support was free",
        "clear the space above, or choose a volume with more headroom",
    ),
    Verdict.NO_RETREAT: (
        "the open hand could not leave the placed object on a straight way",
        "shorten retreat_distance, give grasps from other sides, or set require_retreat to false",
    ),
}


@dataclass(slots=True)
class Statistics:
    """Live counters of a run; written by the planner, read by any thread.

    Attributes:
        count: goal samples and their verdicts.
        goals: goals found, each a candidate for motion planning.
        motion_iterations: iterations of the bidirectional RRTs.
        unreached: motions to goals that could not be certified once timed.
        solutions: placements published.
        best: ξ_best; -inf before the first.
    """

    count: SampleCount
    goals: int = 0
    motion_iterations: int = 0
    unreached: int = 0
    solutions: int = 0
    best: float = float("-inf")

    @property
    def samples(self) -> int:
        """Goal samples tried."""
        return self.count.samples

    @property
    def rejected(self) -> dict[str, int]:
        """How many samples each constraint rejected, by its name in lower case."""
        return {
            verdict.name.lower(): number
            for verdict, number in self.count.verdicts.items()
            if verdict is not Verdict.FEASIBLE
        }

    def why_nothing(self) -> str:
        """One sentence on what stood in the way, and one on what to try."""
        if self.samples == 0:
            return "no sample was tried: the run ended before the search began"
        if self.goals > 0:
            return (
                f"{self.goals} placements were found, but no motion to any of them in "
                f"{self.motion_iterations} planning iterations ({self.unreached} motions failed "
                "certification): allow more time, or clear the way between robot and volume"
            )
        verdict = max(_ADVICE, key=lambda v: self.count.verdicts[v])
        what, remedy = _ADVICE[verdict]
        share = 100.0 * self.count.verdicts[verdict] / self.samples
        furthest = max((v for v in _ADVICE if self.count.verdicts[v] > 0), default=verdict)
        sentence = f"of {self.samples} samples {share:.0f} % failed because {what}: {remedy}"
        if furthest is not verdict:
            what, remedy = _ADVICE[furthest]
            sentence += f"; those that came furthest failed because {what}: {remedy}"
        return sentence
