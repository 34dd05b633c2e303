"""One row per constraint: what samples did that it refused, and which values bear on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from placement_planner_ros.core.errors import listed
from placement_planner_ros.core.explanation.explanation import SENSOR, Remedy, Search
from placement_planner_ros.core.explanation.surfaces import COARSE, FINE, too_steep, unusual_cells
from placement_planner_ros.core.grasp.settings import GraspSettings
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


_ROOM = ("with_unknown", "collision_margin", COARSE)
_MARGINS = ("edge_margin", "support_margin")
_ASKED = ("keep_out", "front", "up", "max_tilt", "required", *_MARGINS)
_SUPPORT = (SENSOR, "max_slope", *_MARGINS, "contact_tolerance", COARSE, FINE, "support")
_MORE_ROOM = ("volume", "choose one with more room beside and above what stands there")
_GRASPS = ("grasps of arm <arm>", "give further ones, with arm and hand clear of what is there")
_NO_RETREAT = ("require_retreat", "false, if the hand need not leave the object")

TABLE = {
    Verdict.OUTSIDE_VOLUME: ConstraintRow(
        "had the centre of mass beside `volume`", (), (("volume", "make it wider than the object"),)
    ),
    Verdict.UNSTABLE: ConstraintRow(
        "left the object without support",
        (*_SUPPORT, *_ASKED),
        (
            ("volume", "choose one with larger surfaces"),
            ("environment", "give a denser or less noisy cloud, if it has holes there"),
        ),
    ),
    Verdict.COLLIDING: ConstraintRow(
        "let the object meet something, at rest or on its way there",
        (*_ROOM, "contact_tolerance", *_ASKED),
        (_MORE_ROOM,),
    ),
    Verdict.BREAKS_RULE: ConstraintRow("broke a rule", _ASKED, ()),
    Verdict.NOT_BETTER: ConstraintRow(
        "were no better by the objective",
        (),
        (("objective", "choose one that is finite somewhere"),),
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
        "had arm, hand or object in collision", (*_ROOM, *_ASKED), (_GRASPS, _MORE_ROOM)
    ),
    Verdict.NO_RELEASE: ConstraintRow(
        "left the fingers no room to open",
        ("collision_margin", *_ASKED),
        (("gripper_open of arm <arm>", "open the fingers less"), _GRASPS, _NO_RETREAT),
    ),
    Verdict.NO_APPROACH: ConstraintRow(
        "had no free straight way onto what carries the object",
        (*_ROOM, "approach_distance", *_ASKED),
        (_MORE_ROOM, _GRASPS),
    ),
    Verdict.NO_RETREAT: ConstraintRow(
        "left the hand no straight way off the placed object",
        ("retreat_distance", *_ROOM, *_ASKED),
        (_GRASPS, _NO_RETREAT),
    ),
}


def demands(search: Search) -> dict[str, str]:
    """By setting, of those that ask for more than they usually do: the value in force, and a
    milder one, in words."""
    told: dict[str, str] = {}
    grasp, usual, footing = search.settings, GraspSettings(), search.poses.footing
    environment = search.problem.environment
    by_vertices = footing.support == "vertices"
    lengths = (
        ("collision_margin", grasp.collision, usual.collision),
        ("approach_distance", grasp.approach, usual.approach),
        ("retreat_distance", grasp.retreat, usual.retreat),
        # each rule has a margin of its own
        ("edge_margin" if by_vertices else "support_margin", footing, search.usual_support),
    )
    # only what asks for more than is usual is worth changing
    for name, asked, default in lengths:
        value, milder = getattr(asked, name), getattr(default, name)
        if value > milder:
            told[name] = f"lower it: {value:g} m is set, {milder:g} m is usual"
    # points that scatter by more than the tolerance leave a level surface without support
    scatter = environment.measured.noise
    if scatter > footing.contact_tolerance:
        told["contact_tolerance"] = (
            f"raise it: heights of the clouds scatter by {scatter:.4f} m about their surfaces, "
            f"{footing.contact_tolerance:g} m are allowed"
        )
    if by_vertices:
        told["support"] = "polygon, which asks for support around the centre of mass alone"
    # more obstacles than were measured, where it is known what was seen: unseen space counts
    if environment.obstacles is not environment.measured and environment.seen is not None:
        told["with_unknown"] = (
            "set it to free, or from occupied to occupied_below where what is unseen lies high, "
            f"or show more: {environment.seen:.0%} of `volume` have been seen"
        )
    if (steep := too_steep(environment)) is not None:
        told |= {each.parameter: each.words for each in steep[1] if each.parameter != "volume"}
    told |= unusual_cells(environment)
    if len(environment.keep_out):
        told["keep_out"] = "make its boxes smaller, or leave out those in the way"
    turns = search.poses.turns
    for side in ("front", "up"):
        if turns is not None and getattr(turns.settings, side):
            told[side] = "leave it out, choose another direction, or more tolerance"
    if grasp.tilt is not None:
        told["max_tilt"] = f"raise it, or leave it out: {grasp.tilt.most:.3f} rad are set"
    if (required := search.poses.required) is not None:
        below = listed([f"{name} of at least {least:g}" for name, _, least in required.terms_asked])
        told["required"] = f"leave some out, or lower `at_least`: {below} is asked"
    return told


def remedies_for(search: Search, *verdicts: Verdict) -> tuple[Remedy, ...]:
    """What to change where constraints refuse: of each, values that ask for much before inputs;
    the first for each parameter."""
    asked = demands(search)
    arms = dict.fromkeys(holding.arm.name for holding in search.finder.holdings)
    found: dict[str, str] = {}
    for row in (TABLE[verdict] for verdict in verdicts):
        for name in row.bearing:
            if name in asked:
                found.setdefault(name.removeprefix("coarse ").removeprefix("fine "), asked[name])
        # `<arm>` stands for every arm that could hold the object
        for name, words in row.inputs:
            names = (name.replace("<arm>", arm) for arm in arms) if "<arm>" in name else [name]
            found.setdefault(", ".join(names), words)
    return tuple(Remedy(name, words) for name, words in found.items())


def shares_in_words(verdicts: Mapping[Verdict, int]) -> str:
    """Counts of samples by verdict, the most frequent first."""
    total = sum(verdicts.values())
    shares = ", ".join(
        f"{verdicts[v] / total:.0%} {TABLE[v].did if v in TABLE else 'were placements'}"
        for v in sorted(verdicts, key=lambda v: -verdicts[v])
        if verdicts[v]
    )
    return f"of {total:,} samples {shares}"
