"""From counts per constraint to the first cause and what to change.

All is told from what the search has counted and proven; nothing is tried out for it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

from placement_planner_ros.core.errors import NAMED_THINGS, listed
from placement_planner_ros.core.explanation.constraint_table import (
    TABLE,
    demands,
    remedies_for,
    shares_in_words,
)
from placement_planner_ros.core.explanation.explanation import Explanation, Remedy, quoted
from placement_planner_ros.core.explanation.search import Progress, Search
from placement_planner_ros.core.explanation.surfaces import (
    regions_in_words,
    too_steep,
    why_no_region,
)
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.types import Verdict
from placement_planner_ros.core.wishes.turns import Turns

_FEW_SAMPLES = 500
"""Samples below which more time is the first thing to try."""
_LITTLE = 0.1
"""Share of samples that a constraint lets pass, to be named beside the one that lets fewest."""
_RULED = {
    Ruling.OUT_OF_REACH: Verdict.NO_IK,
    Ruling.UNSUPPORTED: Verdict.UNSTABLE,
    Ruling.BREAKS_RULE: Verdict.BREAKS_RULE,
    Ruling.COLLIDING: Verdict.COLLIDING,
}


def explain_search(search: Search, progress: Progress) -> Explanation:
    """The cause, what to change, and the counts."""
    left_out = [f"left out: {listed(search.unusable, '; ')}"] if search.unusable else []
    environment, hierarchy = search.problem.environment, search.hierarchy
    steep = too_steep(environment)
    missing = search.poses.contacts.missing()
    # what comes first in the search comes first here: regions, faces, then samples
    if not hierarchy.regions and missing is not None:
        told = Explanation(
            f"no placement region: {missing.words}", (Remedy(missing.parameter, missing.remedy),)
        )
    elif not hierarchy.regions:
        told = why_no_region(environment)
        # regions that there were before may all lie in the boxes to keep out of
        if len(environment.keep_out) and search.before.regions:
            told = Explanation(
                "no placement region: keep_out covers every surface in `volume` that "
                "something could stand on",
                (Remedy("keep_out", demands(search)["keep_out"]),),
            )
    elif hierarchy.faces == 0:
        told = _no_face(search)
    elif not hierarchy.usable:
        told = _no_face_as_asked(search)
    elif steep is not None and _nothing_stood(progress):
        told = replace(steep, cause=steep.cause.replace("no placement region", "nothing stood", 1))
    elif progress.rulings:
        told = _nothing_left(search, progress.rulings)
    elif progress.count.samples == 0:
        told = Explanation(
            "no sample was tried: the run ended before the search began",
            (Remedy("time_limit", "allow more time"),),
        )
    elif progress.found:
        told = _no_motion(search, progress)
    else:
        told = _all_refused(search, progress)
    lacking = [f"contacts: {missing.words}"] if missing is not None else []
    # regions, samples and what was left out are told whatever the cause is
    words = (*regions_in_words(environment), *lacking)
    numbers = (*words, *_count_words(search, progress), *left_out)
    return replace(told, details=(*told.details, *numbers))


def _nothing_stood(progress: Progress) -> bool:
    """Whether something was tried or proven, and all was beside V or unsupported."""
    tried = {verdict for verdict, count in progress.count.verdicts.items() if count}
    return (
        bool(tried or progress.rulings)
        and not progress.found
        and progress.rulings <= {Ruling.UNSUPPORTED}
        # verdicts are in the order of the checks: none came further than support
        and all(verdict <= Verdict.UNSTABLE for verdict in tried)
    )


def _no_face(search: Search) -> Explanation:
    rolling = search.problem.body.rolling
    allow = Remedy("allow_rolling", f"true: {rolling} sides that could roll are left out")
    return Explanation(
        "no placement face: the object can stand on none of its sides",
        (
            *((allow,) if rolling else ()),
            Remedy("center_of_mass", "check it, and the mesh"),
            Remedy("body", "give one with a flat side"),
        ),
    )


def _no_face_as_asked(search: Search) -> Explanation:
    """That `up` and `front` leave no face, each alone or only together."""
    turns = search.poses.turns
    assert turns is not None
    settings, faces = turns.settings, search.problem.body.faces
    # every face on every slope that the regions have
    pairs = [
        (face, slope)
        for face in range(len(faces))
        for slope in {region.slope for region in search.hierarchy.regions}
    ]
    alone = {"up": replace(settings, front=()), "front": replace(settings, up=())}
    # rules of which each alone leaves no face
    blamed = [
        name
        for name, only in alone.items()
        if only.asks and not any(Turns(only, faces).ranges(*pair) for pair in pairs)
    ]
    remedies = [Remedy(name, "give another direction, or none: []") for name in blamed or alone]
    words = ""
    # the least that the direction leans in any rest on any region
    lean = min(turns.least_lean(*pair) for pair in pairs) if settings.up else 0.0
    if lean > settings.up_tolerance:
        tilt = search.settings.tilt
        # the narrower of both limits is the one to raise
        at_rest = tilt is not None and tilt.at_rest <= settings.up_tolerance
        tolerance = "max_tilt" if at_rest else "up_tolerance"
        words = (
            f"; `up` leans by {lean:.3f} rad or more in all of them, by `{tolerance}` it may "
            f"by {settings.up_tolerance:.3f}"
        )
        remedies.insert(0, Remedy(tolerance, f"raise it to {lean + 0.005:.3f} rad"))
    rules = "rules" if len(blamed) == 1 else "rule"
    together = "" if blamed else ", only together"
    return Explanation(
        f"no placement face: {' and '.join(map(quoted, blamed or alone))} {rules} out each of the "
        f"{len(faces)} rests of the object{together}{words}",
        tuple(remedies),
    )


def _nothing_left(search: Search, rulings: frozenset[Ruling]) -> Explanation:
    """What is proven of all that the hierarchy holds."""
    words = {  # what was asked for comes first
        Ruling.BREAKS_RULE: f"against a rule{_required_in_words(search)}",
        Ruling.OUT_OF_REACH: "out of reach of every arm in every grasp",
        Ruling.UNSUPPORTED: "without support, or with the centre of mass outside `volume`",
        Ruling.COLLIDING: "in collision with what was measured there",
    }
    ruled = [words[ruling] for ruling in words if ruling in rulings]
    # Where some poses break a rule alone, that is what to change.
    blamed = [Ruling.BREAKS_RULE] if Ruling.BREAKS_RULE in rulings else list(words)
    return Explanation(
        f"no placement is possible: every pose on the placement regions is {', or '.join(ruled)}",
        _first_of_each(
            r for ruling in blamed if ruling in rulings for r in _ruling_remedies(search, ruling)
        ),
        tuple(
            f"arm {name} falls short of the nearest pose by {gap:.2f} m or more"
            for name, gap in _out_of_reach(search).items()
            if gap > 0.0
        ),
    )


def _ruling_remedies(search: Search, ruling: Ruling) -> list[Remedy]:
    return remedies_for(search, _RULED[ruling])


def _out_of_reach(search: Search) -> dict[str, float]:
    """By arm, the m by which it is proven to fall short of every pose; 0 where it is not."""
    # metres by which every cell is proven out of reach, of each holding
    beyond = search.bounds.beyond_reach(search.hierarchy.sets.cells).min(axis=0)
    least: dict[str, float] = {}
    for holding, gap in zip(search.finder.holdings, beyond.tolist(), strict=True):
        # of an arm the grasp counts that comes nearest
        least[holding.arm.name] = min(gap, least.get(holding.arm.name, gap))
    return least


def _required_in_words(search: Search) -> str:
    """Required terms that no pose reaches, with what is asked and what is proven to be most."""
    bound, cells = search.bounds.required, search.hierarchy.sets.cells
    if bound is None or not search.bounds.turned(cells).all():
        return ""
    most = bound.most_around(search.bounds.ranges(cells))
    # of each term not even the most that any pose can have is enough
    low = [
        f"{name} {bound.at_least[name]:g} is asked, {float(values.max()):.3g} is the most"
        for name, values in most.items()
        if values.max() < bound.at_least[name]
    ]
    return f" (`required`: {', '.join(low)})" if low else ""


def _no_motion(search: Search, progress: Progress) -> Explanation:
    """Goals were found, but no motion to any of them."""
    cause = (
        f"{progress.found:,} placements were found, but no motion to any of them in "
        f"{progress.iterations:,} planning iterations"
    )
    if progress.unreached:
        cause += f" ({progress.unreached:,} motions failed certification)"
    asked = demands(search)
    # rules that hold on the way, too
    bearing = [Remedy(name, asked[name]) for name in ("max_tilt", "keep_out") if name in asked]
    # what helps an arm that collides helps one that finds no way
    inputs = remedies_for(search, Verdict.ARM_COLLIDING)
    more_time = Remedy("time_limit", "allow more time")
    return Explanation(cause, _first_of_each([*bearing, more_time, *inputs]))


def _all_refused(search: Search, progress: Progress) -> Explanation:
    """The constraint that let the smallest share of what came to it pass is the cause; those that
    let little pass are named beside it."""
    count = progress.count
    # of the samples that came to each constraint the share that it let pass, in their order
    passed: dict[Verdict, tuple[float, int, int]] = {}
    left = count.samples
    for verdict, refused in count.verdicts.items():
        if verdict is not Verdict.FEASIBLE and refused:
            # of two that let nothing pass, the one that more came to
            passed[verdict] = max(left - refused, 0.5) / (left + 1.0), refused, left
            left -= refused
    # the narrowest is the cause; as narrow ones are named beside it
    ranked = sorted(passed, key=lambda verdict: passed[verdict][0])
    named = [verdict for verdict in ranked if verdict is ranked[0] or passed[verdict][0] <= _LITTLE]
    causes = []
    for verdict in named:
        _, refused, entered = passed[verdict]
        before = " that passed what is checked before" if entered < count.samples else ""
        rule = verdict is Verdict.BREAKS_RULE
        did = _broken_in_words(search) if rule else TABLE[verdict].did
        causes.append(f"{refused:,} of {entered:,}{before} {did}")
    remedies = [remedy for verdict in named for remedy in remedies_for(search, verdict)]
    # no sample is drawn where nothing is supported, which a wide margin may be to blame for
    asked = demands(search)
    remedies += [Remedy(n, asked[n]) for n in ("edge_margin", "support_margin") if n in asked]
    # few samples say little of what a longer search would find
    if count.samples < _FEW_SAMPLES:
        more_time = f"allow more than it takes for {count.samples:,} samples"
        remedies.insert(0, Remedy("time_limit", more_time))
    cause = f"in {count.samples:,} samples no placement was found: {'; '.join(causes)}"
    return Explanation(cause, _first_of_each(remedies))


def _broken_in_words(search: Search) -> str:
    """The rules that the poses remembered break, the one that most do first."""
    poses = search.finder.rejections.against_rules
    broken = Counter(name for pose in poses for name in search.poses.broken(pose))
    return f"broke {', '.join(name for name, _ in broken.most_common()) or 'a rule'}"


def _count_words(search: Search, progress: Progress) -> list[str]:
    """What became of the samples of faces and walls, of those with the most, and of each arm's
    tries."""
    by_group = progress.count.by_group(search.poses.contacts.groups)
    tried = {group: verdicts for group, verdicts in by_group.items() if verdicts.any()}
    most = sorted(tried, key=lambda group: -int(tried[group].sum()))[:NAMED_THINGS]
    told = [(f"{group}: ", "samples", tried[group]) for group in most]
    # tries to reach poses, by the arm that was tried
    names = [holding.arm.name for holding in search.finder.holdings]
    by_arm = search.finder.rejections.by_name(names)
    told += [(f"arm {name}: ", "tries", tries) for name, tries in by_arm.items()]
    return [
        whose + shares_in_words(dict(zip(Verdict, counts.tolist(), strict=True)), total, noun)
        for whose, noun, counts in told
        if (total := int(counts.sum()))
    ]


def _first_of_each(remedies: Iterable[Remedy]) -> tuple[Remedy, ...]:
    """The first for each parameter."""
    first: dict[str, Remedy] = {}
    for each in remedies:
        first.setdefault(each.parameter, each)
    return tuple(first.values())
