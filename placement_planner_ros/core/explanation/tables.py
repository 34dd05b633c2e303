"""The counts of a search in words: by constraint, by rest of the object and by arm."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from placement_planner_ros.core.errors import NAMED
from placement_planner_ros.core.explanation import rules, surfaces
from placement_planner_ros.core.explanation.search import Search
from placement_planner_ros.core.reach.turntable import DIRECTIONS
from placement_planner_ros.core.reach.upright_motion import most_upright
from placement_planner_ros.core.search.cell_layout import COLUMNS, FACE, LOWER, SLOPE, UPPER, Z
from placement_planner_ros.core.search.sampler import SampleCount
from placement_planner_ros.core.search.uniform import UniformPoses
from placement_planner_ros.core.stability.by_polygon import TIPS
from placement_planner_ros.core.types import LEVEL, Verdict

WHAT = {
    Verdict.OUTSIDE_VOLUME: "had the centre of mass beside target_volume",
    Verdict.UNSTABLE: "left the object without support",
    Verdict.COLLIDING: "let the object meet something, at rest or on its way down",
    Verdict.BREAKS_RULE: "broke a rule",
    Verdict.NOT_BETTER: "were no better by the objective",
    Verdict.NO_IK: "had no arm reach them within its joint limits",
    Verdict.ARM_COLLIDING: "had arm, hand or object in collision",
    Verdict.NO_RELEASE: "left the fingers no room to open",
    Verdict.NO_APPROACH: "had no free straight way down onto the support",
    Verdict.NO_RETREAT: "left the open hand no straight way off the placed object",
}
"""What samples did that a constraint refused."""
_BRIEFLY = {
    Verdict.OUTSIDE_VOLUME: "beside target_volume",
    Verdict.UNSTABLE: "without support",
    Verdict.COLLIDING: "with the object in collision",
    Verdict.BREAKS_RULE: "against a rule",
    Verdict.NOT_BETTER: "no better",
    Verdict.NO_IK: "out of reach",
    Verdict.ARM_COLLIDING: "with arm or hand in collision",
    Verdict.NO_RELEASE: "with no room to open the fingers",
    Verdict.NO_APPROACH: "with no way down",
    Verdict.NO_RETREAT: "with no way back for the hand",
    Verdict.FEASIBLE: "placements",
}
_MUCH = 0.5
"""Share of samples refused from which on a search that found something says so."""
_FEWEST = 100
"""Samples below which that is no news."""
_PLACE = 5
"""Directions that place and way up take."""
_PROBES = 512
"""Poses on the regions by which it is told what is within reach."""


def unsupported(search: Search) -> str:
    """What a pose is that s(x) refuses."""
    footing = search.poses.footing
    if footing.support == "vertices":
        return "without support for every vertex of the placement face"
    return (
        "without support around the centre of mass for "
        f"{footing.support_margin:g} m and a tilt of {math.degrees(TIPS):g} degrees"
    )


def what(search: Search, verdict: Verdict) -> str:
    """What samples did that ended with a verdict."""
    if verdict is Verdict.BREAKS_RULE:
        return f"broke {' and '.join(rules.broken(search)) or 'a rule'}"
    return f"were {unsupported(search)}" if verdict is Verdict.UNSTABLE else WHAT[verdict]


def in_short(count: SampleCount) -> str:
    """What refused most samples of a search that found something; '' where little was refused."""
    refused = {v: n for v, n in count.verdicts.items() if v in WHAT and v != Verdict.NOT_BETTER}
    if count.samples < _FEWEST or sum(refused.values()) <= _MUCH * count.samples:
        return ""
    most = sorted(refused, key=lambda v: -refused[v])[:2]
    reasons = [f"{refused[v] / count.samples:.0%} {WHAT[v]}" for v in most if refused[v]]
    return f"of {count.samples:,} samples {' and '.join(reasons)}"


def by_face(search: Search, count: SampleCount) -> list[str]:
    """What became of the samples of each rest; of many, of those with the most."""
    tried = np.flatnonzero(count.by_face.sum(axis=1))
    most = np.argsort(-count.by_face.sum(axis=1)[tried], kind="stable")[:NAMED]
    rows = []
    for face in np.sort(tried[most]).tolist():
        rest = surfaces.rest_in_words(search.problem.body, face)
        rows.append(f"{rest}: {_shares(count.by_face[face].tolist(), 'samples')}")
    return rows if len(tried) <= NAMED else [*rows, f"and {len(tried) - NAMED} more rests"]


def by_arm(search: Search) -> list[str]:
    """What became of the tries of each arm."""
    names = [holding.arm.name for holding in search.finder.holdings]
    return [
        f"arm {name}: {_shares(verdicts.tolist(), 'tries')}"
        for name, verdicts in search.finder.rejections.by_name(names).items()
        if verdicts.any()
    ]


def lacking(search: Search) -> dict[str, float]:
    """By arm, how much its length falls short of the nearest pose on the regions, m; 0 or less
    where nothing is known to."""
    poses = UniformPoses(search.hierarchy, np.random.default_rng(0), even_share=0.5)
    drawn = poses.draw(_PROBES)
    cells = np.empty((_PROBES, COLUMNS))
    cells[:, FACE] = drawn.face
    cells[:, Z] = [search.hierarchy.regions[k].z for k in drawn.region]
    cells[:, [SLOPE, SLOPE + 1]] = poses.slopes[drawn.region]
    cells[:, LOWER] = cells[:, UPPER] = np.column_stack([drawn.contact[:, :2], drawn.angle])
    beyond = search.bounds.beyond_reach(cells).min(axis=0)
    least: dict[str, float] = {}
    for holding, gap in zip(search.finder.holdings, beyond.tolist(), strict=True):
        least[holding.arm.name] = min(gap, least.get(holding.arm.name, gap))
    return least


def reach_in_words(search: Search) -> list[str]:
    """How far the regions are from what each arm's length allows."""
    return [
        f"arm {name} falls short of the nearest pose by about {gap:.2f} m"
        if gap > 0.0
        else f"arm {name} is long enough for some of the poses"
        for name, gap in lacking(search).items()
    ]


def few_directions(search: Search) -> list[str]:
    """Arms that say themselves how the object is turned, in words."""
    freedom = {
        each.arm.name: each.chain.freedom
        for each in search.finder.holdings
        if each.any_turn is not None
    }
    sloping = any(region.slope != LEVEL for region in search.hierarchy.regions)
    return [
        f"arm {name} moves its tip in {number} of {DIRECTIONS} directions: it puts the object down "
        "turned about the vertical as it can"
        + (", and hardly along the normal of a surface that slopes" * (sloping and number < _PLACE))
        for name, number in freedom.items()
    ]


def hindered(search: Search) -> dict[str, str]:
    """By arm of those that cannot stand the object up wherever they are asked to: why, in words.

    Asked of arms that move their tip in fewer than six directions; on level surfaces.
    """
    faces = search.poses.problem.body.faces
    tolerance = search.settings.ik.rotation_tolerance
    few = [each for each in search.finder.holdings if each.any_turn is not None]
    words: dict[str, str] = {}
    for name in dict.fromkeys(each.arm.name for each in few):
        own = [each for each in few if each.arm.name == name]
        held = (
            (each.arm.grasps[each.grasp] * face.T_face_object.inverse()).homogeneous
            for each in own
            for face in faces
        )
        hindrance = most_upright(own[0].chain, held, tolerance).hindrance(tolerance)
        if hindrance:
            words[name] = f"arm {name} {hindrance}"
    return words


def _shares(verdicts: Sequence[int], noun: str) -> str:
    """Counts by verdict in words, the most frequent first."""
    total = sum(verdicts)
    some = sorted((v for v in Verdict if verdicts[v]), key=lambda v: -verdicts[v])
    shares = ", ".join(f"{_percent(verdicts[v] / total)} {_BRIEFLY[v]}" for v in some)
    return f"of {total:,} {noun} {shares}"


def _percent(share: float) -> str:
    return f"{share:.0%}" if share >= 0.005 else "<1%"
