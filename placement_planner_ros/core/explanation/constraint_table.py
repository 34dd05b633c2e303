"""One row per constraint: what samples did that it refused, and which values bear on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from placement_planner_ros.core.explanation.explanation import Remedy
from placement_planner_ros.core.explanation.search import Search
from placement_planner_ros.core.grasp.settings import GraspSettings
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.search.sampler import SampleCount
from placement_planner_ros.core.types import Verdict


@dataclass(frozen=True, slots=True)
class ConstraintRow:
    """What is said where a constraint refuses samples.

    Attributes:
        did: what the samples did, after their number.
        bearing: settings that bear on it, those most often to blame first.
        inputs: remedies for what has no default: (name, words); `<arm>` stands for each arm.
    """

    did: str
    bearing: tuple[str, ...]
    inputs: tuple[tuple[str, str], ...]


_ROOM = ("with_unknown", "collision_margin", "cell_size")
_ASKED = ("keep_out", "front", "up", "max_tilt", "required")
_GRASPS = ("grasps of arm <arm>", "give further ones")
_MORE_ROOM = ("volume", "choose one with more room beside and above what stands there")

TABLE = {
    Verdict.OUTSIDE_VOLUME: ConstraintRow(
        "had the centre of mass beside `volume`",
        (),
        (("volume", "make it wider than the object"),),
    ),
    Verdict.UNSTABLE: ConstraintRow(
        "left the object without support",
        ("edge_margin", "support_margin", "contact_tolerance", "support", "friction", *_ASKED),
        (
            ("volume", "choose one with larger surfaces"),
            ("environment", "give a denser or less noisy cloud, if it has holes there"),
        ),
    ),
    Verdict.COLLIDING: ConstraintRow(
        "let the object meet something, at rest or on its way there",
        (*_ROOM, *_ASKED),
        (_MORE_ROOM,),
    ),
    Verdict.BREAKS_RULE: ConstraintRow("broke a rule", _ASKED, ()),
    Verdict.NOT_BETTER: ConstraintRow(
        "were no better by the objective",
        (),
        (("objective", "choose one that is above -inf somewhere"),),
    ),
    Verdict.NO_IK: ConstraintRow(
        "had no arm reach them within its joint limits",
        _ASKED,
        (
            ("volume", "move it closer to the robot"),
            _GRASPS,
            ("arms", "name further arms that could hold the object"),
        ),
    ),
    Verdict.ARM_COLLIDING: ConstraintRow(
        "had arm, hand or object in collision",
        (*_ROOM, *_ASKED),
        (
            ("grasps of arm <arm>", "give some that keep the hand away from what is there"),
            _MORE_ROOM,
        ),
    ),
    Verdict.NO_RELEASE: ConstraintRow(
        "left the fingers no room to open",
        ("collision_margin", *_ASKED),
        (
            ("gripper_open of arm <arm>", "open the fingers less"),
            ("grasps of arm <arm>", "give some that keep the fingers away from what is there"),
            ("require_retreat", "false, if the hand need not let go"),
        ),
    ),
    Verdict.NO_APPROACH: ConstraintRow(
        "had no free straight way onto what carries the object",
        (*_ROOM, "approach_distance", *_ASKED),
        (
            ("volume", "choose one with more free height"),
            ("grasps of arm <arm>", "give some with which the arm can come straight there"),
        ),
    ),
    Verdict.NO_RETREAT: ConstraintRow(
        "left the open hand no straight way off the placed object",
        ("retreat_distance", *_ROOM, *_ASKED),
        (
            ("grasps of arm <arm>", "give some from other sides"),
            ("require_retreat", "false, if the hand need not leave"),
        ),
    ),
}


def demands(search: Search) -> dict[str, str]:
    """By setting, of those that ask for more than they usually do: the value in force, and a
    milder one, in words."""
    told: dict[str, str] = {}
    grasp, usual, footing = search.settings, GraspSettings(), search.poses.footing
    environment = search.problem.environment
    lengths = (
        ("collision_margin", grasp.collision, usual.collision),
        ("approach_distance", grasp.approach, usual.approach),
        ("retreat_distance", grasp.retreat, usual.retreat),
        ("edge_margin", footing, search.usual_support),
        ("support_margin", footing, search.usual_support),
        ("cell_size", environment.measured, GridSettings()),
    )
    # only what asks for more than is usual is worth changing
    for name, asked, default in lengths:
        value, milder = getattr(asked, name), getattr(default, name)
        if value > milder:
            told[name] = f"lower it: {value:g} m is set, {milder:g} m is usual"
    if footing.contacts != search.usual_support.contacts:
        told["friction"] = f"raise it, if surfaces are rougher: {footing.friction:g} is set"
    # points that scatter by more than the tolerance leave a level surface without support
    scatter = environment.measured.noise
    if scatter > footing.contact_tolerance:
        told["contact_tolerance"] = (
            f"raise it: heights of the clouds scatter by {scatter:.4f} m about their surfaces, "
            f"{footing.contact_tolerance:g} m are allowed"
        )
    if footing.support == "vertices":
        told["support"] = "polygon, which asks for support around the centre of mass alone"
    # more obstacles than were measured, where it is known what was seen: unseen space counts
    if environment.obstacles is not environment.measured and environment.seen is not None:
        told["with_unknown"] = (
            "set it to free, or to occupied_below where what is unseen lies high, or show more: "
            f"{environment.seen:.0%} of `volume` have been seen"
        )
    if len(environment.keep_out):
        told["keep_out"] = "make its boxes smaller, or leave out those in the way"
    turns = None if search.poses.turns is None else search.poses.turns.settings
    if turns is not None and turns.front:
        told["front"] = "leave it out, choose another direction, or raise its tolerance"
    if turns is not None and turns.up:
        told["up"] = "leave it out, choose another direction, or raise its tolerance"
    if grasp.tilt is not None:
        told["max_tilt"] = f"raise it, or leave it out: {grasp.tilt.most:.3f} rad are set"
    if search.poses.required is not None:
        told["required"] = "leave some out, or lower `at_least`"
    return told


def remedies_for(search: Search, verdict: Verdict) -> list[Remedy]:
    """What to change where a constraint refuses: values that ask for much first, then inputs."""
    row, asked = TABLE[verdict], demands(search)
    arms = dict.fromkeys(holding.arm.name for holding in search.finder.holdings)
    # `<arm>` stands for every arm that could hold the object
    inputs = (
        (", ".join(name.replace("<arm>", arm) for arm in arms) if "<arm>" in name else name, words)
        for name, words in row.inputs
    )
    # values in force before inputs without a default
    values = ((name, asked[name]) for name in row.bearing if name in asked)
    return [Remedy(name, words) for name, words in (*values, *inputs)]


def refused_in_short(count: SampleCount) -> str:
    """What refused samples of a search that found something; '' where few were refused."""
    # a placement that is no better was refused by no constraint
    refused = {verdict: count.verdicts.get(verdict, 0) for verdict in TABLE}
    refused[Verdict.NOT_BETTER] = 0
    # where half or more pass there is nothing to explain
    if sum(refused.values()) <= 0.5 * count.samples:
        return ""
    return shares_in_words(refused, count.samples, "samples")


def shares_in_words(counts: Mapping[Verdict, int], total: int, noun: str) -> str:
    """Counts by verdict as shares of a total, the most frequent first."""
    some = sorted((verdict for verdict in counts if counts[verdict]), key=lambda v: -counts[v])
    shares = ", ".join(
        f"{counts[v] / total:.0%} {TABLE[v].did if v in TABLE else 'were placements'}" for v in some
    )
    return f"of {total:,} {noun} {shares}"
