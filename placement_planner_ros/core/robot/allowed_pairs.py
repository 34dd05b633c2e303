"""Link pairs that self-collision checks leave out: from an SRDF, or derived from the URDF."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from html import escape
from itertools import combinations
from typing import TYPE_CHECKING, Literal

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.errors import listed
from placement_planner_ros.core.robot.overlap import Overlaps
from placement_planner_ros.core.robot.xml_fields import read_xml
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import Array

if TYPE_CHECKING:
    from placement_planner_ros.core.robot.model import Robot

Pair = tuple[str, str]
"""Two link names, sorted."""

SAMPLES = 200
"""Random configurations in all of which links overlap that are left out."""

NEARBY = 3
"""Joints between two links up to which they count as neighbours where the links between have no
geometry, as of shoulders, and up to which their meshes may overlap at the zero pose though the
links never meet: covers, bearings and cables are drawn larger than they are."""

Reason = Literal["Adjacent", "Always", "Default", "User"]
"""Why a pair is left out, as an SRDF says it: neighbours, overlap always, or at the zero pose; of
what an SRDF leaves out itself always the last."""

WORDS: dict[Reason, str] = {"Always": "always overlap", "Default": "overlap at the zero pose"}
"""Of reasons for which a true collision of the two would not be noticed."""


def sorted_pair(a: str, b: str) -> Pair:
    """The two links in sorted order."""
    return (a, b) if a <= b else (b, a)


def srdf_line(links: Pair, reason: str = "User") -> str:
    """The line of an SRDF that has a pair left out."""
    first, second = (escape(link) for link in links)
    return f'<disable_collisions link1="{first}" link2="{second}" reason="{escape(reason)}"/>'


def read_srdf(
    text: str, links: tuple[str, ...]
) -> tuple[dict[Pair, Reason], frozenset[str], list[str]]:
    """What an SRDF says of a robot with these links.

    Understands <disable_collisions>, <disable_default_collisions>, <enable_collisions> and
    <passive_joint>.

    Returns:
        the pairs that self-collision checks leave out, sorted; joints that no motor drives; and
        what to tell of links that the robot has not.

    Raises:
        RobotError: not an SRDF.
    """
    root = read_xml(text, "`srdf`")

    def pairs(tag: str) -> set[Pair]:
        return {sorted_pair(e.get("link1", ""), e.get("link2", "")) for e in root.findall(tag)}

    # Default rules of links, single pairs, and pairs that are enabled again.
    silent = {e.get("link", "") for e in root.findall("disable_default_collisions")}
    given = pairs("disable_collisions")
    disabled = {sorted_pair(a, b) for a in silent.intersection(links) for b in links}
    disabled = (disabled - pairs("enable_collisions")) | given
    # What the URDF has not is told.
    unknown = sorted(silent.union(*given).difference(links))
    told = [f"the SRDF names links that the URDF has not: {listed(unknown)}"] if unknown else []
    passive = frozenset(e.get("name", "") for e in root.findall("passive_joint"))
    known = sorted(pair for pair in disabled if set(pair) <= set(links))
    return dict.fromkeys(known, "User"), passive, told


def left_out_in_words(left_out: Mapping[Pair, Reason]) -> list[str]:
    """What to say of pairs that were left out without an SRDF: neighbours are counted, the others,
    whose true collisions would not be noticed, told one by one."""
    hidden = [f"{a} and {b} {WORDS[why]}" for (a, b), why in left_out.items() if why in WORDS]
    plain = len(left_out) - len(hidden)
    words = f"no SRDF: {plain} pairs of neighbouring links are left out of self-collision checks"
    remedy = "give `srdf` where these can really meet"
    return [words, *(f"left out: {each}; {remedy}" for each in hidden)]


def shape_pairs(
    geometry: pin.GeometryModel, links: Sequence[str], allowed: Collection[Pair]
) -> dict[tuple[int, int], Pair]:
    """Two shapes on different joints -> their links, but for those that are allowed to touch.

    Args:
        links: of each shape.
    """
    joints = [thing.parentJoint for thing in geometry.geometryObjects]
    pairs = {
        (i, j): sorted_pair(links[i], links[j])
        for i, j in combinations(range(len(joints)), 2)
        if joints[i] != joints[j]
    }
    return {shapes: pair for shapes, pair in pairs.items() if pair not in allowed}


def derive_allowed_pairs(robot: Robot) -> dict[Pair, Reason]:
    """Pairs to leave out where no SRDF says so, sorted by name.

    Neighbours (one joint between them, or up to `NEARBY` if none between has geometry), pairs that
    overlap in all of `SAMPLES` random configurations, and those at most `NEARBY` joints apart that
    overlap at the zero pose. Links below a joint that cannot be at zero have no zero pose: at the
    limit next to it an arm may well be folded into itself. All of it on the triangles of the
    meshes; the configurations are the same at each call, and mimicking joints follow their masters.

    Args:
        robot: its own pairs do not matter.

    Raises:
        StoppedError: nobody wants the result any more.
    """
    # Neighbours, and the pairs that are left to be decided.
    model, rng = robot.model, np.random.default_rng(0)
    found: dict[Pair, Reason] = dict.fromkeys(_neighbouring_links(robot), "Adjacent")
    rows = shape_pairs(robot.geometry, robot.geometry_links, found)
    overlaps, data = Overlaps(robot), model.createData()

    def meeting_at(q: Array) -> set[Pair]:
        # Shapes where the joints put them; balls around them first.
        placed = robot.geometry_poses(q, data)
        near = np.array([*rows], dtype=np.int64).reshape(-1, 2)
        near = near[overlaps.near(near, placed)]
        return {rows[i, j] for i, j in near.tolist() if overlaps.meet(i, j, placed[i], placed[j])}

    # The zero pose, of links below joints that can be there.
    zero = robot.with_positions(np.clip(np.zeros(model.nq), robot.lower, robot.upper), {})
    moved = {
        model.getJointId(name)
        for name, value in zip(robot.joint_names, zero, strict=True)
        if value != 0.0 and name not in robot.mimics
    }
    joint = {link: model.frames[robot.frame_id(link)].parentJoint for link in robot.geometry_links}
    for pair in meeting_at(zero):
        ways = [set(model.supports[joint[link]]) for link in pair]
        if len(ways[0] ^ ways[1]) <= NEARBY and not moved & (ways[0] | ways[1]):
            found[pair] = "Default"
    # Random configurations; what once does not overlap is not looked at again.
    for _ in range(SAMPLES):
        step("finding links that always overlap")
        meeting = meeting_at(robot.with_positions(rng.uniform(robot.lower, robot.upper), {}))
        rows = {shapes: pair for shapes, pair in rows.items() if pair in meeting}
    found |= dict.fromkeys(rows.values(), "Always")
    return dict(sorted(found.items()))


def _neighbouring_links(robot: Robot) -> set[Pair]:
    """Each link that has geometry with the next such link towards the root, if that is near."""
    found, frames, links = set(), robot.model.frames, set(robot.geometry_links)
    above = [set(robot.model.supports[frame.parentJoint]) for frame in frames]
    for link in links:
        own = frame = robot.frame_id(link)
        while (frame := frames[frame].parentFrame) and len(above[own] - above[frame]) <= NEARBY:
            if frames[frame].type == pin.FrameType.BODY and frames[frame].name in links:
                found.add(sorted_pair(link, str(frames[frame].name)))
                break
    return found
