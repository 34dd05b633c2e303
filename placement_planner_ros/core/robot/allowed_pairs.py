"""Link pairs that self-collision checks leave out: from an SRDF, or derived from the URDF."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Literal
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.errors import RobotError, listed
from placement_planner_ros.core.robot.arm import follow_masters
from placement_planner_ros.core.robot.description import read_xml
from placement_planner_ros.core.robot.geometry import LinkCover
from placement_planner_ros.core.robot.overlap import Overlaps
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array

BODY = pin.FrameType.BODY

Pair = tuple[str, str]
"""Two link names, sorted."""

SAMPLES = 200
"""Random configurations for the derived pairs."""

ALWAYS = 0.95
"""A pair that overlaps in this share of them or more is left out, as MoveIt's assistant does."""

NEARBY = 3
"""Joints between two links up to which their meshes may overlap at the zero pose though the links
never meet: covers, bearings and cables are drawn larger than they are."""

Reason = Literal["adjacent", "always", "zero"]

_SRDF_REASON = {"adjacent": "Adjacent", "always": "Always", "zero": "Default"}
_WORDS = {
    "adjacent": "adjacent",
    "always": "always overlap",
    "zero": "overlap at the zero pose",
}


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A pair of links that self-collision checks leave out although no SRDF says so.

    Attributes:
        links: which.
        reason: why; at `zero` their meshes overlap, which are close in the chain.
    """

    links: Pair
    reason: Reason

    @property
    def can_hide(self) -> bool:
        """Whether a true collision of the two would not be noticed."""
        return self.reason != "adjacent"

    @property
    def srdf(self) -> str:
        """The line of an SRDF that says the same."""
        return srdf_line(self.links, _SRDF_REASON[self.reason])

    def __str__(self) -> str:
        return f"{self.links[0]} and {self.links[1]} {_WORDS[self.reason]}"


def sorted_pair(a: str, b: str) -> Pair:
    """The two links in sorted order."""
    return (a, b) if a <= b else (b, a)


def srdf_line(links: Pair, reason: str = "User") -> str:
    """The line of an SRDF that has a pair left out."""
    first, second = (quoteattr(link) for link in links)
    return f"<disable_collisions link1={first} link2={second} reason={quoteattr(reason)}/>"


@dataclass(frozen=True, slots=True)
class Semantic:
    """What an SRDF says.

    Attributes:
        allowed: sorted link pairs that self-collision checks leave out.
        passive: joints that no motor drives.
        warnings: on links that it names and the robot has not.
    """

    allowed: frozenset[Pair]
    passive: frozenset[str]
    warnings: tuple[str, ...]


def read_srdf(text: str, links: tuple[str, ...]) -> Semantic:
    """What an SRDF says of a robot with these links.

    Understands <disable_collisions>, <disable_default_collisions>, <enable_collisions> and
    <passive_joint>.

    Raises:
        RobotError: not an SRDF.
    """
    # Default rules of links, single pairs, and pairs that are enabled again.
    root = read_xml(text, "`srdf`")
    if root.tag != "robot":
        raise RobotError("`srdf`", f"<{root.tag}>", "give an SRDF: its root is <robot>")

    def pairs(tag: str) -> set[Pair]:
        return {sorted_pair(e.get("link1", ""), e.get("link2", "")) for e in root.findall(tag)}

    silent = {e.get("link", "") for e in root.findall("disable_default_collisions")}
    given = pairs("disable_collisions")
    # What the URDF has not is warned of.
    unknown = sorted((silent | {link for p in given for link in p}) - set(links))
    disabled = {sorted_pair(a, b) for a in silent.intersection(links) for b in links}
    disabled = (disabled - pairs("enable_collisions")) | given
    warnings = [f"the SRDF names links that the URDF has not: {listed(unknown)}"] * bool(unknown)
    allowed = frozenset(p for p in disabled if set(p) <= set(links))
    passive = frozenset(e.get("name", "") for e in root.findall("passive_joint"))
    return Semantic(allowed, passive, tuple(warnings))


def derive_allowed_pairs(
    ties: Array,
    model: pin.Model,
    geometry: pin.GeometryModel,
    geometry_links: tuple[str, ...],
    covers: tuple[LinkCover | None, ...],
) -> tuple[LeftOut, ...]:
    """Pairs to leave out where no SRDF says so, sorted by name.

    Neighbours (one joint between them; links without geometry are looked through), pairs that
    overlap in at least the share `ALWAYS` of `SAMPLES` random configurations, and those at most
    `NEARBY` joints apart that overlap at the zero pose. Links below a joint that cannot be at zero
    have no zero pose: at the limit next to it an arm may well be folded into itself. All of it on
    the triangles of the meshes; the configurations are the same at each call, and mimicking joints
    follow their masters.

    Args:
        ties: (k, 4) as of an `Arm`, of all joints.

    Raises:
        StoppedError: nobody wants the result any more.
    """
    # Neighbours, and the pairs that are left to be decided.
    links = sorted(set(geometry_links))
    joint = {link: model.frames[model.getFrameId(link, BODY)].parentJoint for link in links}
    neighbours = _neighbouring_links(model, links)
    found: dict[Pair, Reason] = dict.fromkeys(neighbours, "adjacent")
    undecided = [
        p for p in combinations(links, 2) if p not in neighbours and joint[p[0]] != joint[p[1]]
    ]
    rows = _shape_rows(undecided, geometry_links)
    overlaps, data = Overlaps.of(geometry, covers), model.createData()
    shapes = [(g.parentJoint, pin.SE3(g.placement)) for g in geometry.geometryObjects]

    def meeting_at(q: Array) -> set[int]:
        # Shapes where the joints put them; balls around them first.
        pin.forwardKinematics(model, data, q)
        placed = [data.oMi[moved_by] * T_joint_shape for moved_by, T_joint_shape in shapes]
        meeting: set[int] = set()
        for i, j, number in rows[overlaps.near(rows, placed)].tolist():
            if number not in meeting and overlaps.meet(i, j, placed[i], placed[j]):
                meeting.add(number)
        return meeting

    # The zero pose, of links below joints that can be there.
    lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    zero = follow_masters(ties, np.clip(np.zeros(model.nq), lower, upper))
    moved = {n + 1 for n in np.flatnonzero(zero).tolist() if n not in ties[:, 0]}
    for a, b in (undecided[n] for n in meeting_at(zero)):
        ways = [set(model.supports[joint[link]]) for link in (a, b)]
        if len(ways[0] ^ ways[1]) <= NEARBY and not moved & (ways[0] | ways[1]):
            found[a, b] = "zero"
    # Random configurations; what cannot come to its share any more is not looked at again.
    seen, rng = np.zeros(len(undecided), dtype=np.int64), np.random.default_rng(0)
    for left in range(SAMPLES - 1, -1, -1):
        if not len(rows):
            break
        step("finding links that always overlap")
        seen[list(meeting_at(follow_masters(ties, rng.uniform(lower, upper))))] += 1
        rows = rows[(seen + left >= ALWAYS * SAMPLES)[rows[:, 2]]]
    found |= {undecided[number]: "always" for number in set(rows[:, 2].tolist())}
    return tuple(LeftOut(*each) for each in sorted(found.items()))


def _neighbouring_links(model: pin.Model, links: list[str]) -> set[Pair]:
    """Each of the links with the next of them towards the root."""
    found = set()
    for link in links:
        # Up to the next link that has geometry.
        frame = model.getFrameId(link, BODY)
        while (frame := model.frames[frame].parentFrame) != 0:
            above = model.frames[frame]
            if above.type == BODY and above.name in links:
                found.add(sorted_pair(link, str(above.name)))
                break
    return found


def _shape_rows(pairs: list[Pair], geometry_links: tuple[str, ...]) -> npt.NDArray[np.int64]:
    """(n, 3) every shape of the one link with every shape of the other, and the pair's number."""
    of_link: dict[str, list[int]] = {}
    for i, link in enumerate(geometry_links):
        of_link.setdefault(link, []).append(i)
    rows = [
        (i, j, number)
        for number, (a, b) in enumerate(pairs)
        for i in of_link[a]
        for j in of_link[b]
    ]
    return np.array(rows, dtype=np.int64).reshape(-1, 3)
