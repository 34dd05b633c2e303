"""Link pairs that self-collision checks leave out: from an SRDF, or derived from the URDF."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations
from typing import Literal
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.did_you_mean import did_you_mean
from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.description import Description, read_xml
from placement_planner_ros.core.robot.geometry import LinkCover
from placement_planner_ros.core.robot.overlap import Overlaps
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array

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

_NAMED = 20
"""Unknown links that are warned of one by one."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A pair of links that self-collision checks leave out although no SRDF says so.

    Attributes:
        links: which.
        reason: why; `zero` and `start` are the poses at which their meshes overlap.
        joints: movable joints between them.
        depth: metres by which one must be moved that their meshes overlap no more, where they were
            first seen to overlap; 0 where nobody looked.
        share: of random configurations in which they overlap.
    """

    links: Pair
    reason: Reason
    joints: int
    depth: float = field(default=0.0, compare=False)
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
        if self.can_hide:
            words += f", {self.depth:.4f} m deep"
        if self.share:
            words += f", in {self.share:.0%} of random configurations"
        return words


def pair(a: str, b: str) -> Pair:
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
    root = read_xml(text, "robot_description_semantic")
    if root.tag != "robot":
        raise RobotError(
            "robot_description_semantic", f"<{root.tag}>", "give an SRDF: its root is <robot>"
        )

    def pairs(tag: str) -> set[Pair]:
        return {pair(e.get("link1", ""), e.get("link2", "")) for e in root.findall(tag)}

    silent = {e.get("link", "") for e in root.findall("disable_default_collisions")}
    given = pairs("disable_collisions")
    unknown = sorted((silent | {link for p in given for link in p}) - set(links))
    disabled = {pair(a, b) for a in silent.intersection(links) for b in links}
    disabled = (disabled - pairs("enable_collisions")) | given
    warnings = [_unknown(link, links) for link in unknown[:_NAMED]]
    if len(unknown) > _NAMED:
        warnings.append(f"the SRDF names {len(unknown) - _NAMED} more that the URDF has not")
    allowed = frozenset(p for p in disabled if set(p) <= set(links))
    passive = frozenset(e.get("name", "") for e in root.findall("passive_joint"))
    return Semantic(allowed, passive, tuple(warnings))


def _unknown(link: str, links: tuple[str, ...]) -> str:
    meant = did_you_mean(link, links)
    words = "" if meant is None else f"; the nearest is {meant}"
    return f"the SRDF names link {link!r}, which the URDF has not{words}"


def derive(
    description: Description,
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

    Raises:
        StoppedError: nobody wants the result any more.
    """
    links = sorted(set(geometry_links))
    between = joints_between(model)
    joint = {link: _joint_of(model, link) for link in links}

    def apart(p: Pair) -> int:
        return int(between[joint[p[0]], joint[p[1]]])

    neighbours = _neighbours(description, links)
    found = [LeftOut(p, "adjacent", apart(p)) for p in neighbours]
    undecided = {
        p: apart(p)
        for p in combinations(links, 2)
        if p not in neighbours and joint[p[0]] != joint[p[1]]
    }
    poses = _Poses(description, model)
    rows = _PairRows(undecided, geometry, geometry_links, covers)
    found += _overlapping(rows, undecided, model, geometry, poses)
    return tuple(sorted(found, key=lambda left_out: left_out.links))


class NearPairs:
    """The pairs of a robot that are checked and lie at most `NEARBY` joints apart."""

    def __init__(
        self,
        model: pin.Model,
        geometry: pin.GeometryModel,
        geometry_links: tuple[str, ...],
        covers: tuple[LinkCover | None, ...],
    ) -> None:
        self._model, self._geometry = model, geometry
        carriers = [thing.parentJoint for thing in geometry.geometryObjects]
        joints = np.array(carriers, dtype=np.int64)
        checked = np.array([(p.first, p.second) for p in geometry.collisionPairs], dtype=np.int64)
        checked = checked.reshape(-1, 2)
        apart = joints_between(model)[joints[checked[:, 0]], joints[checked[:, 1]]]
        near = np.flatnonzero(apart <= NEARBY)
        self._joints = {
            pair(geometry_links[a], geometry_links[b]): int(n)
            for (a, b), n in zip(checked[near].tolist(), apart[near], strict=True)
        }
        self._rows = _PairRows(self._joints, geometry, geometry_links, covers)

    def overlapping_at(self, q: Array) -> tuple[LeftOut, ...]:
        """Those whose meshes overlap at q (nq,).

        Where the robot itself stands there, they are not in each other.
        """
        rows = self._rows
        depths = rows.depths_at(self._model, self._geometry, q)
        return tuple(
            LeftOut(p, "start", self._joints[p], depths[n])
            for n, p in enumerate(rows.pairs)
            if n in depths
        )


def joints_between(model: pin.Model) -> npt.NDArray[np.int64]:
    """(njoints, njoints) movable joints on the way from what one joint carries to another."""
    ways: list[list[int]] = [[]]
    for joint in range(1, model.njoints):
        ways.append([*ways[model.parents[joint]], joint])
    number = len(ways)
    apart = np.zeros((number, number), dtype=np.int64)
    for a, b in combinations(range(number), 2):
        common = sum(1 for x, y in zip(ways[a], ways[b], strict=False) if x == y)
        apart[a, b] = apart[b, a] = len(ways[a]) + len(ways[b]) - 2 * common
    return apart


def _joint_of(model: pin.Model, link: str) -> int:
    return int(model.frames[model.getFrameId(link, pin.FrameType.BODY)].parentJoint)


def _neighbours(description: Description, links: list[str]) -> set[Pair]:
    above = {
        str(j.find("child").get("link")): str(j.find("parent").get("link"))  # type: ignore[union-attr]
        for j in description.root.findall("joint")
    }
    known, found = set(links), set()
    for link in links:
        parent = above.get(link)
        while parent is not None and parent not in known:
            parent = above.get(parent)
        if parent is not None:
            found.add(pair(link, parent))
    return found


class _Poses:
    """Configurations of a robot, (nq,) each, in which mimicking joints follow."""

    def __init__(self, description: Description, model: pin.Model) -> None:
        names = list(model.names[1:])
        joints = [description.joints[name] for name in names]
        self._lower = np.array([joint.lower for joint in joints])
        self._upper = np.array([joint.upper for joint in joints])
        self._mimics = [
            (i, names.index(joint.mimic.master), joint.mimic)
            for i, joint in enumerate(joints)
            if joint.mimic is not None
        ]
        self._parents = list(model.parents)
        self._rng = np.random.default_rng(0)

    def zero(self) -> Array:
        """All joints at zero, or at the limit next to it."""
        return self._follow(np.clip(np.zeros(len(self._lower)), self._lower, self._upper))

    def have_zero(self) -> set[int]:
        """The joints (0 being the world) that are at zero there with all that carry them."""
        q, able = self.zero(), {0}
        for joint in range(1, len(self._parents)):
            if self._parents[joint] in able and (q[joint - 1] == 0.0 or self._follows(joint - 1)):
                able.add(joint)
        return able

    def _follows(self, i: int) -> bool:
        return any(follower == i for follower, _, _ in self._mimics)

    def random(self) -> Array:
        """Uniform within the limits."""
        return self._follow(self._rng.uniform(self._lower, self._upper))

    def _follow(self, q: Array) -> Array:
        for follower, master, mimic in self._mimics:
            q[follower] = mimic.multiplier * q[master] + mimic.offset
        return q


class _PairRows:
    """The shapes of some pairs of links.

    Attributes:
        pairs: the links, numbered.
        table: (n, 3) every pair of shapes of each of them, and its number.
    """

    def __init__(
        self,
        pairs: dict[Pair, int],
        geometry: pin.GeometryModel,
        links: tuple[str, ...],
        covers: tuple[LinkCover | None, ...],
    ) -> None:
        self.pairs = sorted(pairs)
        self.overlaps = Overlaps.of(geometry, covers)
        of_link: dict[str, list[int]] = {}
        for i, link in enumerate(links):
            of_link.setdefault(link, []).append(i)
        rows = [
            (i, j, number)
            for number, (a, b) in enumerate(self.pairs)
            for i in of_link[a]
            for j in of_link[b]
        ]
        self.table = np.array(rows, dtype=np.int64).reshape(-1, 3)

    def meeting(self, placements: list[pin.SE3]) -> set[int]:
        """Numbers of the pairs that overlap."""
        found: set[int] = set()
        for i, j, number in self.table[self.overlaps.near(self.table, placements)].tolist():
            if number not in found and self.overlaps.meet(i, j, placements[i], placements[j]):
                found.add(number)
        return found

    def depths_at(
        self,
        model: pin.Model,
        geometry: pin.GeometryModel,
        q: Array,
        wanted: set[int] | None = None,
    ) -> dict[int, float]:
        """Metres by which each pair (or each that is wanted) overlaps at q (nq,), if it does."""
        placements = _placements(model, geometry, q)
        numbers = self.meeting(placements) if wanted is None else wanted
        depths: dict[int, float] = {}
        for i, j, number in self.table.tolist():
            if number in numbers:
                step(f"measuring how deep {' and '.join(self.pairs[number])} overlap")
                depth = self.overlaps.depth(i, j, placements[i], placements[j])
                depths[number] = max(depths.get(number, 0.0), depth)
        return depths


def _placements(model: pin.Model, geometry: pin.GeometryModel, q: Array) -> list[pin.SE3]:
    data = geometry.createData()
    pin.updateGeometryPlacements(model, model.createData(), geometry, data, q)
    return list(data.oMg)


def _overlapping(
    rows: _PairRows,
    undecided: dict[Pair, int],
    model: pin.Model,
    geometry: pin.GeometryModel,
    poses: _Poses,
) -> list[LeftOut]:
    """Of these pairs, with the joints between them, those whose meshes say that they never meet."""
    apart = np.array([undecided[p] for p in rows.pairs], dtype=np.int64)
    zero = poses.zero()
    posed = poses.have_zero()
    at_zero = {
        n
        for n in rows.meeting(_placements(model, geometry, zero))
        if apart[n] <= NEARBY and all(_joint_of(model, link) in posed for link in rows.pairs[n])
    }
    needed = np.where(apart <= NEARBY, OFTEN, ALWAYS)
    needed[list(at_zero)] = 0.0
    seen = np.zeros(len(apart), dtype=np.int64)
    first: dict[int, Array] = dict.fromkeys(at_zero, zero)
    for sample in range(SAMPLES):
        if not len(rows.table):
            break
        step("finding links that overlap in most configurations")
        q = poses.random()
        for number in rows.meeting(_placements(model, geometry, q)):
            seen[number] += 1
            first.setdefault(number, q)
        # what cannot come to the share that it needs any more is not looked at again
        possible = seen + (SAMPLES - 1 - sample)
        rows.table = rows.table[(possible >= needed * SAMPLES)[rows.table[:, 2]]]
    share = seen / SAMPLES
    found = []
    kept = sorted(set(rows.table[:, 2].tolist()))
    for number in kept:
        reason: Reason = "zero" if number in at_zero else "often"
        if share[number] >= ALWAYS:
            reason = "always"
        elif reason == "often" and not (share[number] > OFTEN and apart[number] <= NEARBY):
            continue
        depths = rows.depths_at(model, geometry, first[number], {number})
        found.append(
            LeftOut(
                rows.pairs[number],
                reason,
                int(apart[number]),
                depths[number],
                float(share[number]),
            )
        )
    return found
