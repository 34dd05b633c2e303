"""Link pairs that self-collision checks leave out: from an SRDF, or derived from the URDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Literal
from xml.sax.saxutils import quoteattr

import numpy as np
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

OFTEN = 0.5
"""Above this share a pair of links at most `NEARBY` joints apart is left out."""

NEARBY = 3
"""Joints between two links up to which their meshes may overlap though the links never meet:
covers, bearings and cables are drawn larger than they are."""

Reason = Literal["adjacent", "always", "often", "zero", "start"]

_SRDF_REASON = {"adjacent": "Adjacent", "always": "Always"}
_WORDS = {
    "adjacent": "adjacent",
    "always": "always overlap",
    "often": "overlap in most configurations",
    "zero": "overlap at the zero pose",
    "start": "overlap where the robot stands",
}


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A pair of links that self-collision checks leave out although no SRDF says so.

    Attributes:
        links: which.
        reason: why; `zero` and `start` are the poses at which their meshes overlap.
        joints: movable joints between them.
        share: of random configurations in which they overlap.
    """

    links: Pair
    reason: Reason
    joints: int
    share: float = field(default=0.0, compare=False)

    @property
    def can_hide(self) -> bool:
        """Whether a true collision of the two would not be noticed."""
        return self.reason != "adjacent"

    @property
    def srdf(self) -> str:
        """The line of an SRDF that says the same."""
        return srdf_line(self.links, _SRDF_REASON.get(self.reason, "User"))

    def __str__(self) -> str:
        words = f"{self.links[0]} and {self.links[1]} {_WORDS[self.reason]}"
        if self.share:
            words += f", in {self.share:.0%} of random configurations"
        return words


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
    root = read_xml(text, "robot_description_semantic")
    if root.tag != "robot":
        raise RobotError(
            "robot_description_semantic", f"<{root.tag}>", "give an SRDF: its root is <robot>"
        )

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
    overlap in at least the share `ALWAYS` of `SAMPLES` random configurations, and of those at most
    `NEARBY` joints apart the ones that overlap at the zero pose or in more than the share `OFTEN`.
    Links below a joint that cannot be at zero have no zero pose: at the limit next to it an arm
    may well be folded into itself. All of it on the triangles of the meshes; the configurations
    are the same at each call, and mimicking joints follow their masters.

    Args:
        ties: (k, 4) as of an `Arm`, of all joints.

    Raises:
        StoppedError: nobody wants the result any more.
    """
    # Neighbours, and the pairs that are left to be decided.
    links = sorted(set(geometry_links))
    joint = {link: model.frames[model.getFrameId(link, BODY)].parentJoint for link in links}
    neighbours = _neighbouring_links(model, links)
    apart = {(a, b): joints_between(model, joint[a], joint[b]) for a, b in combinations(links, 2)}
    found = [LeftOut(p, "adjacent", apart[p]) for p in neighbours]
    undecided = [p for p in apart if p not in neighbours and joint[p[0]] != joint[p[1]]]
    pairs = LinkPairs(undecided, model, geometry, geometry_links, covers)

    # The zero pose, of links below joints that can be there.
    lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    zero = follow_masters(ties, np.clip(np.zeros(model.nq), lower, upper))
    moved = {n + 1 for n in np.flatnonzero(zero).tolist() if n not in ties[:, 0]}
    # The share that each pair needs; at the zero pose any.
    needed = np.array([OFTEN if apart[p] <= NEARBY else ALWAYS for p in undecided])
    at_zero = {
        n
        for n in pairs.meeting_at(zero)
        if apart[undecided[n]] <= NEARBY
        and not any(moved.intersection(model.supports[joint[link]]) for link in undecided[n])
    }
    needed[list(at_zero)] = 0.0
    # Random configurations, of which each pair needs a share.
    seen, rng = np.zeros(len(undecided), dtype=np.int64), np.random.default_rng(0)
    for left in range(SAMPLES - 1, -1, -1):
        if not len(pairs.rows):
            break
        step("finding links that overlap in most configurations")
        q = follow_masters(ties, rng.uniform(lower, upper))
        seen[list(pairs.meeting_at(q))] += 1
        # What cannot come to the share that it needs any more is not looked at again.
        pairs.rows = pairs.rows[(seen + left >= needed * SAMPLES)[pairs.rows[:, 2]]]
    # What is left has come to its share.
    for number in sorted(set(pairs.rows[:, 2].tolist())):
        links_, share = undecided[number], float(seen[number] / SAMPLES)
        if share >= ALWAYS:
            found.append(LeftOut(links_, "always", apart[links_], share))
        elif number in at_zero:
            found.append(LeftOut(links_, "zero", apart[links_], share))
        elif share > OFTEN and apart[links_] <= NEARBY:
            found.append(LeftOut(links_, "often", apart[links_], share))
    return tuple(sorted(found, key=lambda left_out: left_out.links))


def joints_between(model: pin.Model, a: int, b: int) -> int:
    """Movable joints on the way from what one joint carries to another."""
    return len(set(model.supports[a]) ^ set(model.supports[b]))


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


class LinkPairs:
    """The shapes of some pairs of links.

    Attributes:
        pairs: the links, numbered.
        rows: (n, 3) every pair of shapes of each of them, and its number.
    """

    def __init__(
        self,
        pairs: Sequence[Pair],
        model: pin.Model,
        geometry: pin.GeometryModel,
        geometry_links: tuple[str, ...],
        covers: tuple[LinkCover | None, ...],
    ) -> None:
        self.pairs = tuple(pairs)
        self._model = model
        self._shapes = [(g.parentJoint, pin.SE3(g.placement)) for g in geometry.geometryObjects]
        self._overlaps = Overlaps.of(geometry, covers)
        # Every shape of the one link against every shape of the other.
        of_link: dict[str, list[int]] = {}
        for i, link in enumerate(geometry_links):
            of_link.setdefault(link, []).append(i)
        rows = [
            (i, j, number)
            for number, (a, b) in enumerate(self.pairs)
            for i in of_link[a]
            for j in of_link[b]
        ]
        self.rows = np.array(rows, dtype=np.int64).reshape(-1, 3)

    @classmethod
    def that_are_checked(
        cls,
        model: pin.Model,
        geometry: pin.GeometryModel,
        geometry_links: tuple[str, ...],
        covers: tuple[LinkCover | None, ...],
    ) -> LinkPairs:
        """Those at most `NEARBY` joints apart that a robot's self-collision checks look at."""
        joints = [thing.parentJoint for thing in geometry.geometryObjects]
        near = {
            sorted_pair(geometry_links[p.first], geometry_links[p.second])
            for p in geometry.collisionPairs
            if joints_between(model, joints[p.first], joints[p.second]) <= NEARBY
        }
        return cls(sorted(near), model, geometry, geometry_links, covers)

    def meeting_at(self, q: Array) -> set[int]:
        """Numbers of the pairs whose meshes overlap at q (nq,)."""
        data = self._model.createData()
        # Shapes where the joints put them; balls around them first.
        pin.forwardKinematics(self._model, data, q)
        placed = [data.oMi[joint] * T_joint_shape for joint, T_joint_shape in self._shapes]
        found: set[int] = set()
        for i, j, number in self.rows[self._overlaps.near(self.rows, placed)].tolist():
            if number not in found and self._overlaps.meet(i, j, placed[i], placed[j]):
                found.add(number)
        return found

    def left_out_at(self, q: Array) -> tuple[LeftOut, ...]:
        """Those that overlap at q (nq,), where the robot stands: they are not in each other."""
        # Those that overlap, and the joints between them.
        links = [self.pairs[number] for number in sorted(self.meeting_at(q))]
        joint = [
            [self._model.frames[self._model.getFrameId(link, BODY)].parentJoint for link in both]
            for both in links
        ]
        return tuple(
            LeftOut(both, "start", joints_between(self._model, *ids))
            for both, ids in zip(links, joint, strict=True)
        )
