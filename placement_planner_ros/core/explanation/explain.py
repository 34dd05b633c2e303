"""Why a search found nothing: the cause, what to try, and the numbers behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from placement_planner_ros.core.errors import listed
from placement_planner_ros.core.explanation import collisions, rules, surfaces, tables
from placement_planner_ros.core.explanation.advice import advice, closer, grasps, support
from placement_planner_ros.core.explanation.explanation import Explanation, Remedy
from placement_planner_ros.core.explanation.search import Progress, Search
from placement_planner_ros.core.explanation.tilted_way import tilted_way
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.search.sampler import SampleCount
from placement_planner_ros.core.types import Verdict

_FEW = 500
"""Samples below which more time is the first thing to try."""
_LITTLE = 0.1
"""A constraint that lets less than this share pass is named beside the main one."""
_OF_POSES = {Verdict.UNSTABLE, Verdict.COLLIDING, Verdict.BREAKS_RULE}
"""Of the constraints, those on poses alone, which rules of users can make hard to meet."""
_OF_ARMS = {verdict for verdict in Verdict if Verdict.NOT_BETTER < verdict < Verdict.FEASIBLE}
"""Those on arms: rules of users can leave only poses that fail them."""


def explain(search: Search, progress: Progress) -> Explanation:
    """Why nothing was found."""
    left_out = [f"left out: {listed(search.unusable, '; ')}"] if search.unusable else []
    environment = search.problem.environment
    if not search.hierarchy.regions:
        told = surfaces.why_no_region(environment)
        if len(environment.keep_out) and search.before.regions:
            told = Explanation(
                "no placement region: keep_out covers every surface in target_volume that "
                "something could stand on",
                (rules.SMALLER_BOXES, Remedy("target_volume", "choose one with further surfaces")),
            )
        seen = surfaces.seen_in_words(environment)
        return Explanation(told.cause, told.remedies, (*told.details, *seen, *left_out))
    if search.hierarchy.faces and not search.hierarchy.usable:
        return rules.no_rest_as_asked(search)
    if search.hierarchy.faces == 0:
        rolling = search.problem.body.rolling
        tries = [
            Remedy("object.center_of_mass", "check it, and the mesh"),
            Remedy("object.mesh", "give one with a flat side"),
        ]
        if rolling:
            tries.insert(
                0, Remedy("object.allow_rolling", f"offers {rolling} sides that could roll")
            )
        return Explanation(
            "no placement face: the object can stand on none of its sides", tuple(tries)
        )
    if progress.rulings:
        told = _ruled_out(search, progress.rulings)
    elif progress.count.samples == 0:
        told = Explanation(
            "no sample was tried: the run ended before the search began",
            (Remedy("time_limit", "allow more time"),),
        )
    elif progress.found:
        told = _unreached(search, progress)
    else:
        told = _hindered(search, _refused(search, progress.count))
    numbers = (
        surfaces.in_words(environment),
        *surfaces.seen_in_words(environment),
        *tables.reach_in_words(search),
        *tables.few_directions(search),
        *tables.by_face(search, progress.count),
        *tables.by_arm(search),
    )
    return Explanation(told.cause, told.remedies, (*told.details, *numbers, *left_out))


def _ruled_out(search: Search, rulings: frozenset[Ruling]) -> Explanation:
    """Nothing is left to look at, which is proven."""
    words: list[str] = []
    remedies: list[Remedy] = []
    details: list[str] = []
    if Ruling.OUT_OF_REACH in rulings:
        gap = min(tables.lacking(search).values())
        words.append("out of reach of every arm in every grasp")
        words[-1] += f", by {gap:.2f} m and more" if gap > 0.0 else ""
        remedies += closer(search, gap)
    if Ruling.BREAKS_RULE in rulings:
        below, tries = rules.too_low(search)
        words.append(below)
        remedies += tries
    if Ruling.UNSUPPORTED in rulings:
        body = search.problem.body
        rest = surfaces.rest_in_words(body, surfaces.smallest_rest(body))
        words.append(
            f"{tables.unsupported(search)}, or with the centre of mass outside target_volume"
        )
        words[-1] += f"; the smallest is {rest}"
        tries, seen = support(search)
        remedies += tries
        details += seen
    blamed: list[Remedy] = []
    if Ruling.OUT_OF_REACH in rulings:
        blamed += rules.for_arms(search)
    if rulings & {Ruling.BREAKS_RULE, Ruling.UNSUPPORTED}:
        blamed += _but_for(blamed, rules.others(search))
    remedies = [*blamed, *_but_for(blamed, remedies)]
    every = f"every pose on the placement regions is {', or '.join(words)}"
    return Explanation(f"no placement is possible: {every}", tuple(remedies), tuple(details))


def _unreached(search: Search, progress: Progress) -> Explanation:
    """Placements were found, but no motion to any of them."""
    cause = (
        f"{progress.found:,} placements were found, but no motion to any of them in "
        f"{progress.iterations:,} planning iterations"
    )
    if progress.unreached:
        cause += f" ({progress.unreached:,} motions failed certification)"
    remedies = [Remedy("time_limit", "allow more time")]
    details: list[str] = []
    blamed = tilted_way(search, progress.goals)
    if blamed is not None:
        cause += blamed.cause
        remedies.insert(0 if blamed.certain else 1, blamed.remedy)
        details.append(blamed.seen)
    remedies += grasps(search, "give some with which the way there is free")
    if search.settings.collision.collision_margin > 0.0:
        remedies.append(Remedy("collision_margin", "lower it, or clear the way"))
    for holding in search.finder.holdings:
        key = holding.arm.name, holding.grasp
        ends = [goal.q_raised for goal in progress.goals if (goal.arm, goal.grasp) == key]
        met = collisions.met_on_the_way(holding, ends)
        if met.most:
            details.append(f"on the straight ways of arm {key[0]} with grasp {key[1]}: {met}")
    return Explanation(cause, tuple(remedies), tuple(details))


def _hindered(search: Search, told: Explanation) -> Explanation:
    """That no arm can stand the object up comes before all else that is seen."""
    words = tables.hindered(search)
    if not words:
        return told
    arms = {holding.arm.name for holding in search.finder.holdings}
    if len(words) < len(arms):
        return replace(told, details=(*words.values(), *told.details))
    tries = (
        Remedy(
            ", ".join(f"{name}.grasps" for name in words),
            "hold the object so that the joints can bring it upright, exactly; rounded angles in "
            "the URDF can make it lean, too",
        ),
        Remedy("arms", "name one with more joints that move independently"),
    )
    cause = f"{'; '.join(words.values())}; {told.cause}"
    return Explanation(cause, (*tries, *told.remedies), told.details)


def _refused(search: Search, count: SampleCount) -> Explanation:
    """No sample passed every constraint: the one that let the smallest share pass is the cause."""
    stages: dict[Verdict, tuple[int, int, float]] = {}
    left = count.samples
    for verdict, refused in count.verdicts.items():
        if verdict is not Verdict.FEASIBLE and refused:
            # where nothing passed, what refused many weighs more than what refused few
            passed = max(left - refused, 0.5) / (left + 1.0)
            stages[verdict] = refused, left, passed
            left -= refused
    ranked = sorted(stages, key=lambda verdict: stages[verdict][2])
    named = [verdict for verdict in ranked if verdict is ranked[0] or stages[verdict][2] <= _LITTLE]
    causes: list[str] = []
    remedies = rules.for_arms(search) if _OF_ARMS & set(named) else []
    if _OF_POSES & set(named):
        remedies += _but_for(remedies, rules.others(search))
    details: list[str] = []
    for verdict in named:
        refused, entered, _ = stages[verdict]
        before = " that passed what is checked before" if entered < count.samples else ""
        causes.append(f"{refused:,} of {entered:,}{before} {tables.what(search, verdict)}")
        more, seen = advice(search, verdict)
        remedies += _but_for(remedies, more)
        details += seen
    if count.samples < _FEW:
        more_time = Remedy("time_limit", f"allow more than it takes for {count.samples:,} samples")
        remedies.insert(0, more_time)
    cause = f"in {count.samples:,} samples no placement was found: {'; '.join(causes)}"
    return Explanation(cause, tuple(remedies), tuple(details))


def _but_for(known: Sequence[Remedy], more: Sequence[Remedy]) -> list[Remedy]:
    """Of more remedies, those for other parameters than the known ones."""
    parameters = {each.parameter for each in known}
    return [each for each in more if each.parameter not in parameters]
