"""Which rule of users is to blame, and what to change about it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from placement_planner_ros.core.constraints import REQUIRED
from placement_planner_ros.core.explanation.arms_without import reached_without
from placement_planner_ros.core.explanation.explanation import Explanation, Remedy
from placement_planner_ros.core.explanation.other_rules import in_the_way
from placement_planner_ros.core.explanation.search import Search
from placement_planner_ros.core.sample_goals.placed_cells import PlacedCells
from placement_planner_ros.core.search.cell_layout import whole_cells
from placement_planner_ros.core.types import Verdict
from placement_planner_ros.core.wishes.turns import VERTICAL, Turns

SMALLER_BOXES = Remedy("keep_out", "make its boxes smaller, or leave out those in the way")
"""What to try where boxes to keep out of are in the way."""
_OFTEN = 0.5
"""Of the times that the rule is broken that is broken most, others are named that are so often."""


def no_rest_as_asked(search: Search) -> Explanation:
    """That the object can be put down on none of its rests in the way it shall be turned."""
    turns = search.poses.turns
    assert turns is not None
    settings, faces = turns.settings, search.poses.problem.body.faces
    slopes = {region.slope for region in search.hierarchy.regions}
    pairs = [(face, slope) for face in range(len(faces)) for slope in slopes]
    alone = {
        "object.up": replace(settings, front=()),
        "object.front": replace(settings, up=()),
    }
    blamed = [
        name
        for name, only in alone.items()
        if only.asks and not any(map(Turns(only, faces).ranges, *zip(*pairs, strict=True)))
    ]
    remedies = []
    words = []
    if "object.up" in blamed or not blamed:
        lean = min(turns.least_lean(*pair) for pair in pairs)
        tolerance = _up_tolerance(search)
        words.append(
            f"object.up leans by {lean:.3f} rad or more in all of them, by {tolerance} it "
            f"may by {settings.up_tolerance:.3f}"
        )
        if lean > settings.up_tolerance:
            remedies.append(Remedy(tolerance, f"raise it to {lean + 0.003:.3f} rad"))
        remedies.append(Remedy("object.up", "give another direction, or none: []"))
    if "object.front" in blamed or not blamed:
        words.append(
            "object.front is vertical, by less than "
            f"{math.degrees(VERTICAL):g} degrees, in all that are left"
        )
        remedies.append(Remedy("object.front", "give another direction, or none: []"))
    remedies.append(
        Remedy("object.allow_rolling", "offers sides that could roll, where it has any")
    )
    rule = "rules" if len(blamed) == 1 else "rule"
    together = "" if blamed else ", only together"
    return Explanation(
        f"no placement face: {' and '.join(blamed or alone)} {rule} out each "
        f"of the {len(faces)} rests of the object{together}: {'; '.join(words)}",
        tuple(remedies),
    )


def broken(search: Search) -> list[str]:
    """The rules that refused poses looked at again break most often, by their parameters."""
    poses = search.finder.rejections.poses[Verdict.BREAKS_RULE]
    counted = Counter(name for p in poses for name in search.poses.broken(p.T_world_object))
    most = max(counted.values(), default=0)
    return [name for name, times in counted.most_common() if times >= _OFTEN * most]


def advice(search: Search) -> tuple[list[Remedy], list[str]]:
    """What to try where poses break a rule."""
    tolerances = {
        "object.up": Remedy(_up_tolerance(search), "raise it"),
        "object.front": Remedy("object.front_tolerance", "raise it"),
    }
    names = broken(search)
    remedies = [tolerances[name] for name in names if name in tolerances]
    required = search.poses.required
    terms = [name.removeprefix(f"{REQUIRED}: ") for name in names if name.startswith(REQUIRED)]
    if required is None or not terms:
        return remedies, []
    seen = search.finder.rejections.poses[Verdict.BREAKS_RULE]
    best = {term: max(required.terms(pose.T_world_object)[term] for pose in seen) for term in terms}
    least = required.at_least
    words = ", ".join(f"{term} {least[term]:g}" for term in terms)
    reached = ", ".join(f"{term} {value:.3g}" for term, value in best.items())
    remedies += [
        Remedy("require_at_least", f"lower it: {words} is asked, {reached} the most that was seen"),
        Remedy("require_terms", f"leave out {' or '.join(terms)}"),
    ]
    return remedies, [f"of {len(seen)} poses looked at again {reached} was the most"]


def too_low(search: Search) -> tuple[str, list[Remedy]]:
    """Required terms that nothing reaches, which is proven."""
    known = search.bounds.required
    bounds = known.most(PlacedCells(whole_cells(search.hierarchy)))
    found = {name: float(values.max()) for name, values in bounds.items()}
    alone = [name for name, value in found.items() if value < known.at_least[name]]
    low = alone or [name for name, value in found.items() if math.isfinite(value)]
    words = ", ".join(f"{name} {known.at_least[name]:g}" for name in low)
    reached = ", ".join(f"{name} {found[name]:.3g}" for name in low)
    most, lower = f", {reached} at most", f"no pose has more than {reached}"
    if not alone:  # bounds of large cells say little; those of the small ones were too low
        all_ = "all of it at once" if len(low) > 1 else "it"
        most, lower = f", and no pose reaches {all_}", f"no pose reaches {all_}"
    return (
        f"below what require_terms asks ({words}){most}",
        [
            Remedy("require_at_least", f"lower it: {lower}"),
            Remedy("require_terms", f"leave out {' or '.join(low)}"),
        ],
    )


def others(search: Search) -> list[Remedy]:
    """Rules without any one of which poses are seen to stand free and keep the others."""
    return _left_out(
        search, in_the_way(search), "without it poses are seen to keep all else that is asked"
    )


def for_arms(search: Search) -> list[Remedy]:
    """Rules without any one of which an arm is seen to reach poses that keep the others."""
    return _left_out(
        search,
        reached_without(search),
        "without it an arm is seen to reach poses that keep all else that is asked",
    )


def _left_out(search: Search, names: Sequence[str], seen: str) -> list[Remedy]:
    """To leave out any one of the rules of these names, for what is seen without it."""
    words = {
        "keep_out": SMALLER_BOXES.words,
        "object.front": "leave it out, or choose another direction",
        "object.up": "leave it out, or choose another direction",
        "carry.max_tilt": "raise it, or leave it out",
        "require_terms": "leave some out, or lower require_at_least",
    }
    if search.settings.tilt is not None:
        words["object.up"] = "leave it out, and carry.max_tilt with it"
    return [Remedy(name, f"{words[name]}: {seen}") for name in names]


def _up_tolerance(search: Search) -> str:
    """Of the parameters that limit by how much object.up may lean at rest, the narrower one."""
    turns, tilt = search.poses.turns, search.settings.tilt
    if turns is None or tilt is None or turns.settings.up_tolerance < tilt.at_rest:
        return "object.up_tolerance"
    return "carry.max_tilt"
