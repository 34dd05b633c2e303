"""From counts per constraint to the first cause and what to change.

All is told from what the search has counted and proven; nothing is tried out for it.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace

from placement_planner_ros.core.errors import listed
from placement_planner_ros.core.explanation.constraint_table import (
    TABLE,
    demands,
    remedies_for,
    shares_in_words,
)
from placement_planner_ros.core.explanation.explanation import Explanation, Remedy, Search, quoted
from placement_planner_ros.core.explanation.surfaces import regions_in_words, why_no_region
from placement_planner_ros.core.search.pruning import Ruling
from placement_planner_ros.core.statistics import Statistics
from placement_planner_ros.core.types import Verdict

_FEW_SAMPLES = 500
"""Samples below which more time is the first thing to try."""
_LONGER = "let it, or whoever stops the search, allow more time"
_RULED = {  # what was asked for comes first
    Ruling.BREAKS_RULE: ((Verdict.BREAKS_RULE,), "against a rule"),
    Ruling.OUT_OF_REACH: ((Verdict.NO_IK,), "out of reach of every arm in every grasp"),
    Ruling.UNSUPPORTED: (
        (Verdict.OUTSIDE_VOLUME, Verdict.UNSTABLE),
        "without support, or with the centre of mass outside `volume`",
    ),
    Ruling.COLLIDING: ((Verdict.COLLIDING,), "in collision with what was measured there"),
}
"""The constraints that rule out cells, and what every pose in them is."""


def explain_search(search: Search, statistics: Statistics, rulings: Set[Ruling]) -> Explanation:
    """The cause, what to change, and the counts.

    Args:
        statistics: how far the search has got.
        rulings: why nothing is left to look at; empty where something is.
    """
    told = _first_cause(search, statistics, rulings)
    count, missing = statistics.count, search.poses.contacts.missing()
    # regions, samples and what was left out are told whatever the cause is
    numbers = [
        *regions_in_words(search.problem.environment),
        *([] if missing is None else [f"contacts: {missing.words}"]),
        *([shares_in_words(count.verdicts)] if count.samples else []),
        *([f"left out: {listed(search.unusable, '; ')}"] if search.unusable else []),
    ]
    return replace(told, details=(*told.details, *numbers))


def _first_cause(search: Search, statistics: Statistics, rulings: Set[Ruling]) -> Explanation:
    """What comes first in the search comes first here: regions, faces, then samples."""
    environment, hierarchy = search.problem.environment, search.hierarchy
    missing = search.poses.contacts.missing()
    if not hierarchy.regions and missing is not None:
        cause = f"no placement region: {missing.words}"
        return Explanation(cause, (Remedy(missing.parameter, missing.remedy),))
    # regions that there were before may all lie in the boxes to keep out of
    if not hierarchy.regions and len(environment.keep_out) and search.before.regions:
        cause = "no placement region: `keep_out` covers every surface in `volume`"
        return Explanation(cause, (Remedy("keep_out", demands(search)["keep_out"]),))
    if not hierarchy.regions:
        return why_no_region(environment)
    if hierarchy.faces == 0:
        cause = "no placement face: the object can stand on none of its sides"
        return Explanation(cause, (Remedy("body", "give one with a flat side"),))
    if not hierarchy.usable:
        return _no_face_as_asked(search)
    if rulings:
        return _nothing_left(search, statistics, rulings)
    if statistics.samples == 0:
        cause = "no sample was tried: the run ended before the search began"
        return Explanation(cause, (Remedy("time_limit", _LONGER),))
    return _no_motion(search, statistics) if statistics.goals else _all_refused(search, statistics)


def _no_face_as_asked(search: Search) -> Explanation:
    """That `object.up` and `object.front` leave no face."""
    told, faces = demands(search), len(search.problem.body.faces)
    asked = [name for name in ("up", "front", "max_tilt") if name in told]
    rules = " and ".join(map(quoted, asked))
    cause = f"no placement face: none of the {faces} rests of the object keeps {rules}"
    return Explanation(cause, tuple(Remedy(name, told[name]) for name in asked))


def _nothing_left(search: Search, statistics: Statistics, rulings: Set[Ruling]) -> Explanation:
    """What is proven of all that the hierarchy holds; what most samples lacked is to change."""
    ruled = [_RULED[ruling] for ruling in _RULED if ruling in rulings]
    # where some poses break a rule alone, that is what to change
    blamed = ruled[:1] if Ruling.BREAKS_RULE in rulings else ruled
    refused = statistics.count.verdicts
    verdicts = [verdict for of_ruling, _ in blamed for verdict in of_ruling]
    return Explanation(
        "no placement is possible: every pose on the placement regions is "
        f"{', or '.join(words for _, words in ruled)}",
        remedies_for(search, *sorted(verdicts, key=lambda each: -refused.get(each, 0))),
    )


def _no_motion(search: Search, statistics: Statistics) -> Explanation:
    """Goals were found, but no motion to any of them."""
    cause = (
        f"{statistics.goals:,} placements were found, but no motion to any of them in "
        f"{statistics.motion_iterations:,} planning iterations"
    )
    if statistics.unreached:
        cause += f" ({statistics.unreached:,} motions could not be shown to be free)"
    # what helps an arm that collides helps one that finds no way
    more_time = Remedy("time_limit", _LONGER)
    return Explanation(cause, (more_time, *remedies_for(search, Verdict.ARM_COLLIDING)))


def _all_refused(search: Search, statistics: Statistics) -> Explanation:
    """The constraint that let the smallest share of what came to it pass is the cause."""
    count = statistics.count
    # of the samples that came to each constraint the share that it let pass, in their order
    passed: dict[Verdict, tuple[float, int, int]] = {}
    left = count.samples
    for verdict, refused in count.verdicts.items():
        if verdict is not Verdict.FEASIBLE and refused:
            # of two that let nothing pass, the one that more came to
            passed[verdict] = max(left - refused, 0.5) / (left + 1.0), refused, left
            left -= refused
    verdict, (_, refused, entered) = min(passed.items(), key=lambda each: each[1])
    before = " that passed what is checked before" if entered < count.samples else ""
    # the last one let none of the rest pass
    remedies = remedies_for(search, verdict, next(reversed(passed)))
    # few samples say little of what a longer search would find
    longer = (Remedy("time_limit", _LONGER),) if count.samples < _FEW_SAMPLES else ()
    return Explanation(
        f"in {count.samples:,} samples no placement was found: {refused:,} of {entered:,}{before} "
        f"{TABLE[verdict].did}",
        (*longer, *remedies),
    )
