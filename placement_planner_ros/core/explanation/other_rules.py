"""Which rules keep poses from standing free as required: some are drawn without each, to see."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from placement_planner_ros.core.constraints import PoseConstraints
from placement_planner_ros.core.explanation.search import Search
from placement_planner_ros.core.search.hierarchy import AfrHierarchy
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


def in_the_way(search: Search) -> list[str]:
    """The rules, by their parameters, without any one of which poses are seen that stand free and
    keep all others, where none is seen with it; whether arms reach these is not looked at."""
    without = list(_without_each(search))
    if not without or _reach(search.poses, search):
        return []
    return [name for name, poses in without if _reach(poses, search)]


def _without_each(search: Search) -> Iterator[tuple[str, PoseConstraints]]:
    """The constraints on poses without each rule that is set, but for terms that are required."""
    turns = None if search.poses.turns is None else search.poses.turns.settings
    inside = search.problem.environment
    left_out = {}
    if len(inside.keep_out):
        left_out["keep_out"] = search.before, turns
    if turns is not None and turns.front:
        left_out["object.front"] = inside, replace(turns, front=())
    if turns is not None and turns.up:
        left_out["object.up"] = inside, replace(turns, up=())
    for name, (environment, others) in left_out.items():
        yield (
            name,
            PoseConstraints(
                replace(search.problem, environment=environment),
                search.settings.collision,
                search.poses.footing,
                search.settings.approach.approach_minimum,
                others,
                search.poses.required,
            ),
        )


def _reach(poses: PoseConstraints, search: Search) -> bool:
    """Whether any pose is seen to keep all rules."""
    ranges = None if poses.turns is None else poses.turns.ranges
    faces = len(poses.problem.body.faces)
    hierarchy = AfrHierarchy([1], faces, poses.regions, search.hierarchy.settings, ranges)
    if not (poses.regions and hierarchy.usable):
        return False
    rng = np.random.default_rng(0)
    sets = UniformPoses(hierarchy, rng)
    drawn, within = sets.draw(_DRAWN), 1.0
    known = drawn, np.full(_DRAWN, np.inf)
    for _ in range(_ROUNDS + 1):
        lacking = np.zeros(_DRAWN)
        slopes = sets.slopes[drawn.region]
        verdicts, _ = poses.verdicts(drawn.face, drawn.contact, drawn.angle, slopes, lacking)
        if (verdicts == Verdict.FEASIBLE).any():
            return True
        lacking[verdicts != Verdict.BREAKS_RULE] = np.inf
        known = _best(known, (drawn, lacking))
        if not np.isfinite(known[1]).any():
            return False
        drawn = _around(known[0], sets, within, rng)
        within *= 0.5
    return False


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
