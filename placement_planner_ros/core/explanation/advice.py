"""For each constraint that refuses samples: what to try, and what a second look at some shows."""

from __future__ import annotations

import math
from dataclasses import replace

from placement_planner_ros.core.explanation import collisions, rules, surfaces
from placement_planner_ros.core.explanation.collisions import Met
from placement_planner_ros.core.explanation.explanation import Remedy
from placement_planner_ros.core.explanation.search import Search
from placement_planner_ros.core.types import Verdict

_SPARED = 0.1
"""Share of refused poses that a setting must make good to be named."""
_HOLES = 0.1
"""Share of the surface in V that shows no point, to be named."""
_TOLERANCE = 0.01
"""m, the contact_tolerance that is tried on poses without support."""

Advice = tuple[list[Remedy], list[str]]
"""Remedies, the most promising first, and what was seen."""


def advice(search: Search, verdict: Verdict) -> Advice:
    """What to try where samples ended with that verdict."""
    if verdict is Verdict.OUTSIDE_VOLUME:
        return [Remedy("target_volume", "make it wider than the object")], []
    if verdict is Verdict.UNSTABLE:
        return support(search)
    if verdict is Verdict.COLLIDING:
        return _room(search)
    if verdict is Verdict.BREAKS_RULE:
        return rules.advice(search)
    if verdict is Verdict.NOT_BETTER:
        return [Remedy("objective", "choose one that is above -inf somewhere")], []
    if verdict is Verdict.NO_IK:
        return closer(search), []
    return _hand(search, verdict)


def support(search: Search) -> Advice:
    """What to try where something lacks support."""
    environment = search.problem.environment
    remedies: list[Remedy] = []
    seen: list[str] = []
    slope = surfaces.steep_in(environment)
    if slope is not None:
        remedies += surfaces.level(slope)
        seen.append(surfaces.sloping(slope, environment.max_slope))
    remedies += surfaces.shown(environment)
    holes = surfaces.holes_in(environment)
    if holes > _HOLES:
        remedies += [surfaces.coarser(environment), surfaces.MERGED]
        seen.append(f"{holes:.0%} of the surface in target_volume are holes that show no point")
    tries, told = surfaces.too_sparse(environment)
    known = {each.parameter for each in remedies}
    remedies += [each for each in tries if each.parameter not in known]
    remedies += _other_footing(search)
    if holes <= _HOLES and not tries:
        remedies += surfaces.smoother(environment)
    seen += told or surfaces.uneven_in_words(environment)
    body, footing = search.problem.body, search.poses.footing
    if footing.support == "polygon":
        words = "choose one with surfaces that reach farther around the object's centre of mass"
        return [*remedies, Remedy("target_volume", words)], seen
    width, depth, _ = surfaces.rest_size(body, surfaces.smallest_rest(body))
    margin = 2.0 * footing.edge_margin
    words = (
        f"choose one with larger surfaces, level for {width + margin:.3f} x {depth + margin:.3f} m "
        "at least, and look at ~/occupancy for holes in them"
    )
    return [*remedies, Remedy("target_volume", words)], seen


def _other_footing(search: Search) -> list[Remedy]:
    """By which other settings of s(x) poses would stand that were refused, or others."""
    problem, footing = search.problem, search.poses.footing
    by_polygon = footing.support == "polygon"
    margin = "support_margin" if by_polygon else "edge_margin"
    remedies = []
    rejected = collisions.thinned(search.finder.rejections.poses[Verdict.UNSTABLE])
    if rejected and footing.contact_tolerance < _TOLERANCE:
        wider = replace(footing, contact_tolerance=_TOLERANCE)
        spared = collisions.stable_with(problem, wider, rejected)
        if spared >= _SPARED * len(rejected):
            words = (
                f"raise it: with {_TOLERANCE:g} m {spared} of {len(rejected)} would be supported"
            )
            remedies.append(Remedy("contact_tolerance", words))
    if rejected and getattr(footing, margin) > 0.0:
        none = replace(footing, edge_margin=0.0, support_margin=0.0)
        spared = collisions.stable_with(problem, none, rejected)
        if spared >= _SPARED * len(rejected):
            words = f"lower it: with 0 m {spared} of {len(rejected)} would be supported"
            remedies.append(Remedy(margin, words))
    if not by_polygon:
        collision, raised = search.settings.collision, search.settings.approach.approach_minimum
        drawn, standing = collisions.standing_by_polygon(problem, collision, footing, raised)
        if standing:
            words = (
                f"polygon: {standing} of {drawn} poses drawn at random would stand free with the "
                "centre of mass above what carries them"
            )
            remedies.append(Remedy("support", words))
    return remedies


def closer(search: Search, gap: float = 0.0) -> list[Remedy]:
    """What to try where nothing is within reach, or lacks `gap` metres."""
    by = f", by {gap:.2f} m or more" if gap > 0.0 else ""
    return [
        Remedy("target_volume", f"move it closer to the robot{by}"),
        *grasps(search, "give further ones"),
        Remedy("arms", "name further arms that could hold the object"),
    ]


def grasps(search: Search, words: str) -> list[Remedy]:
    """Of every arm that was used."""
    names = dict.fromkeys(holding.arm.name for holding in search.finder.holdings)
    return [Remedy(", ".join(f"{name}.grasps" for name in names), words)]


def _unknown() -> Remedy:
    return Remedy(
        "unknown_space",
        "set it to free (or to occupied_below where what is unseen lies high), or show what is "
        "unseen: clouds from further sides, with cloud.mode: merge",
    )


def _narrower(met: Met) -> Remedy:
    words = f"lower it: with 0 m {met.spared} of {met.poses} poses looked at again would be free"
    return Remedy("collision_margin", words)


def _room(search: Search) -> Advice:
    """What to try where the object itself meets something."""
    settings, raised = search.settings.collision, search.settings.approach.approach_minimum
    rejected = search.finder.rejections.poses[Verdict.COLLIDING]
    met = collisions.met_by_object(search.problem, settings, raised, rejected)
    remedies: list[Remedy] = []
    if 3 * met.kept_out > met.looked > 0:
        remedies.append(rules.SMALLER_BOXES)
    if 2 * met.unseen > met.looked:
        remedies.append(_unknown())
    if met.poses and met.spared >= _SPARED * met.poses:
        remedies.append(_narrower(met))
    if 2 * met.above > met.looked:
        body, free = search.problem.body, surfaces.headroom(search.problem.environment)
        needed = surfaces.rest_size(body, surfaces.lowest_rest(body))[2] + raised
        words = f"choose one with more free height, {needed + settings.collision_margin:.3f} m"
        words += " at least" if math.isinf(free) else f" at least; at most {free:.3f} m are free"
    else:
        words = "choose one with more free surface, or clear some space"
    tries, told = surfaces.too_sparse(search.problem.environment)
    return [*remedies, *tries, Remedy("target_volume", words)], [*_seen("the object", met), *told]


def _hand(search: Search, verdict: Verdict) -> Advice:
    """What to try where arm or hand are in the way."""
    rejected = search.finder.rejections.poses[verdict]
    met = collisions.met_by_arm(search.finder.holdings, rejected, search.problem.environment)
    remedies = [_unknown()] if 2 * met.unseen > met.looked else []
    if 3 * met.kept_out > met.looked > 0:
        remedies.insert(0, rules.SMALLER_BOXES)
    if met.poses and met.spared >= _SPARED * met.poses:
        remedies.append(_narrower(met))
    if verdict is Verdict.ARM_COLLIDING:
        remedies += grasps(search, "give some that keep the hand away from what it meets")
        remedies.append(Remedy("target_volume", "choose one with more room around it"))
    elif verdict is Verdict.NO_RELEASE:
        arms = dict.fromkeys(holding.arm.name for holding in search.finder.holdings)
        opened = ", ".join(f"{name}.gripper_open" for name in arms)
        remedies.append(Remedy(opened, "open the fingers less"))
        remedies += grasps(search, "give some that keep the fingers away from the support")
        remedies.append(Remedy("require_retreat", "false, if the hand need not let go"))
    elif verdict is Verdict.NO_APPROACH:
        remedies.append(Remedy("target_volume", "choose one with more free height"))
        remedies += grasps(search, "give some with which the arm can come straight down")
    else:
        remedies.append(Remedy("retreat_distance", "shorten it"))
        remedies += grasps(search, "give some from other sides")
        remedies.append(Remedy("require_retreat", "false, if the hand need not leave"))
    return remedies, _seen("arm and hand", met)


def _seen(who: str, met: Met) -> list[str]:
    return [f"{who}: {met}"] if met.most else []
