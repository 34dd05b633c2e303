"""Which rules keep poses from standing free as required: some are drawn without each, to see."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.explanation.search import Search
from placement_planner_ros.core.grasp.settings import GraspSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
from placement_planner_ros.core.search.sampler import Draws
from placement_planner_ros.core.search.uniform import UniformDraws, UniformPoses
from placement_planner_ros.core.types import Array, Verdict

_DRAWN = 500
"""Poses drawn from everywhere, ..."""
_ROUNDS = 6
"""... and rounds in which as many are drawn ..."""
_BEST = 10
"""... around so many of those that lack least so far, ..."""
_AWAY, _TURNED = 0.08, 0.8
"""m and rad: ... within so much of them, in each further round within half of that."""

Judged = tuple[UniformDraws, Array]
"""Poses, and (n,) what they lack."""


@dataclass(frozen=True, slots=True, eq=False)
class Without:
    """A search without one of its rules.

    Attributes:
        rule: by its parameter.
        problem, settings, poses: its own then; the first two are the search's where the rule is
            one on poses alone.
    """

    rule: str
    problem: Problem
    settings: GraspSettings
    poses: PoseConstraints


def in_the_way(search: Search) -> list[str]:
    """The rules, by their parameters, without any one of which poses are seen that stand free and
    keep all others, where none is seen with it; whether arms reach these is not looked at, nor
    what terms are required."""
    without = [each for each in without_each(search) if each.rule != "require_terms"]
    if not without or _any(search.poses, search):
        return []
    return [each.rule for each in without if _any(each.poses, search)]


def without_each(search: Search) -> Iterator[Without]:
    """The search without each rule that is set."""
    problem, settings, required = search.problem, search.settings, search.poses.required
    turns = None if search.poses.turns is None else search.poses.turns.settings
    tilted = settings if settings.tilt is None else replace(settings, tilt=None)
    left_out = {}
    if len(problem.environment.keep_out):
        left_out["keep_out"] = replace(problem, environment=search.before), settings, turns
    if turns is not None and turns.front:
        left_out["object.front"] = problem, settings, replace(turns, front=())
    if turns is not None and turns.up:
        left_out["object.up"] = problem, tilted, replace(turns, up=())
    if turns is not None and settings.tilt is not None:
        leaning = replace(turns, up_tolerance=search.up_tolerance)
        left_out["carry.max_tilt"] = problem, tilted, leaning
    if required is not None:
        left_out["require_terms"] = problem, settings, turns
    for rule, (others, grasp, allowed) in left_out.items():
        yield Without(
            rule,
            others,
            grasp,
            PoseConstraints(
                others,
                settings.collision,
                search.poses.footing,
                settings.approach.approach_minimum,
                allowed,
                None if rule == "require_terms" else required,
            ),
        )


def standing(poses: PoseConstraints, search: Search) -> Iterator[Draws]:
    """Poses that are seen to stand free and keep all rules, those of a round together."""
    ranges = None if poses.turns is None else poses.turns.ranges
    faces = len(poses.problem.body.faces)
    hierarchy = AfrHierarchy([1], faces, poses.regions, search.hierarchy.settings, ranges)
    if not (poses.regions and hierarchy.usable):
        return
    rng = np.random.default_rng(0)
    sets = UniformPoses(hierarchy, rng)
    drawn, within = sets.draw(_DRAWN), 1.0
    known = drawn, np.full(_DRAWN, np.inf)
    for _ in range(_ROUNDS + 1):
        lacking = np.zeros(_DRAWN)
        slopes = sets.slopes[drawn.region]
        verdicts, _ = poses.verdicts(drawn.face, drawn.contact, drawn.angle, slopes, lacking)
        rows = np.flatnonzero(verdicts == Verdict.FEASIBLE)
        if len(rows):
            anyone = np.full(len(rows), -1)
            of = drawn.face[rows], drawn.contact[rows], drawn.angle[rows], slopes[rows]
            yield Draws(anyone, anyone, *of)
        if len(rows) >= _BEST:  # they are no rare ones
            drawn = sets.draw(_DRAWN)
            continue
        lacking[(verdicts != Verdict.BREAKS_RULE) & (verdicts != Verdict.FEASIBLE)] = np.inf
        known = _best(known, (drawn, lacking))
        if not np.isfinite(known[1]).any():
            return
        drawn = _around(known[0], sets, within, rng)
        within *= 0.5


def _any(poses: PoseConstraints, search: Search) -> bool:
    return next(standing(poses, search), None) is not None


def _best(before: Judged, drawn: Judged) -> Judged:
    """The few of both that lack least."""
    lacking = np.concatenate([before[1], drawn[1]])
    rows = np.argsort(lacking, kind="stable")[:_BEST]
    both = [
        np.concatenate([getattr(each[0], name) for each in (before, drawn)])[rows]
        for name in ("region", "face", "contact", "angle")
    ]
    return UniformDraws(*both), lacking[rows]


def _around(
    best: UniformDraws, sets: UniformPoses, within: float, rng: np.random.Generator
) -> UniformDraws:
    """Poses on the planes of these, within shares of `_AWAY` and `_TURNED` of them."""
    of = rng.integers(len(best.face), size=_DRAWN)
    aside = within * _AWAY * rng.uniform(-1.0, 1.0, (_DRAWN, 2))
    rise = (aside * sets.slopes[best.region[of]]).sum(axis=1)
    contact = best.contact[of] + np.column_stack([aside, rise])
    angle = best.angle[of] + within * _TURNED * rng.uniform(-1.0, 1.0, _DRAWN)
    return UniformDraws(best.region[of], best.face[of], contact, angle)
