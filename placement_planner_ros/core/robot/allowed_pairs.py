"""Link pairs that self-collision checks leave out: from an SRDF, or derived from the URDF."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.core.robot.description import Description, read_xml
from placement_planner_ros.core.types import Array

Pair = tuple[str, str]
"""Two link names, sorted."""

SAMPLES = 200
"""Random configurations for the derived pairs."""

ALWAYS = 0.95
"""A pair that collides in this share of them or more is left out, as MoveIt's assistant does."""


_NAMED = 20
"""Unknown links that are warned of one by one."""


def pair(a: str, b: str) -> Pair:
    """The two links in sorted order."""
    return (a, b) if a <= b else (b, a)


def read_srdf(text: str, links: tuple[str, ...]) -> tuple[frozenset[Pair], tuple[str, ...]]:
    """Disabled pairs of an SRDF, and warnings on the links it names that the robot has not.

    Understands <disable_collisions>, <disable_default_collisions> and <enable_collisions>.

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
    warnings = [
        f"the SRDF names link {link!r}, which the URDF has not" for link in unknown[:_NAMED]
    ]
    if len(unknown) > _NAMED:
        warnings.append(f"the SRDF names {len(unknown) - _NAMED} more that the URDF has not")
    return frozenset(p for p in disabled if set(p) <= set(links)), tuple(warnings)


def derive(
    description: Description,
    model: pin.Model,
    geometry: pin.GeometryModel,
    geometry_links: tuple[str, ...],
) -> frozenset[Pair]:
    """Pairs to leave out where no SRDF says so.

    Neighbours (one joint between them; links without geometry are looked through), the two sides
    of a mimic joint (fingers that meet when closed), and pairs that collide in at least the share
    `ALWAYS` of `SAMPLES` random configurations. The configurations are the same at each call.
    """
    links = sorted(set(geometry_links))
    allowed = _neighbours(description, links) | _mimic_sides(description, links)
    joint = {link: _joint_of(model, link) for link in links}
    undecided = {
        p for p in combinations(links, 2) if p not in allowed and joint[p[0]] != joint[p[1]]
    }
    return frozenset(
        allowed | _always_colliding(description, model, geometry, geometry_links, undecided)
    )


def _joint_of(model: pin.Model, link: str) -> int:
    return int(model.frames[model.getFrameId(link, pin.FrameType.BODY)].parentJoint)


def _neighbours(description: Description, links: list[str]) -> set[Pair]:
    above = {
        str(j.find("child").get("link")): str(j.find("parent").get("link"))  # type: ignore[union-attr]
        for j in description.root.findall("joint")
    }
    found = set()
    for link in links:
        parent = above.get(link)
        while parent is not None and parent not in links:
            parent = above.get(parent)
        if parent is not None:
            found.add(pair(link, parent))
    return found


def _mimic_sides(description: Description, links: list[str]) -> set[Pair]:
    child = {
        str(j.get("name")): str(j.find("child").get("link"))  # type: ignore[union-attr]
        for j in description.root.findall("joint")
    }
    sides = (
        pair(child[joint.name], child[joint.mimic.master])
        for joint in description.joints.values()
        if joint.mimic is not None
    )
    return {p for p in sides if p[0] in links and p[1] in links}


def _always_colliding(
    description: Description,
    model: pin.Model,
    geometry: pin.GeometryModel,
    geometry_links: tuple[str, ...],
    undecided: set[Pair],
) -> set[Pair]:
    rng = np.random.default_rng(0)
    data, geometry_data = model.createData(), geometry.createData()
    shapes = [thing.geometry for thing in geometry.geometryObjects]
    for shape in shapes:
        shape.computeLocalAABB()
    centers = np.array([shape.aabb_center for shape in shapes]).reshape(-1, 3)
    radii = np.array([shape.aabb_radius for shape in shapes])
    numbers = {p: n for n, p in enumerate(sorted(undecided))}
    # every pair of objects of an undecided pair of links, and that pair's number
    rows = [
        (i, j, numbers[pair(geometry_links[i], geometry_links[j])])
        for i, j in combinations(range(len(shapes)), 2)
        if pair(geometry_links[i], geometry_links[j]) in numbers
    ]
    table = np.array(rows, dtype=np.int64).reshape(-1, 3)
    free = np.zeros(len(numbers), dtype=np.int64)
    lower = np.array([description.joints[name].lower for name in model.names[1:]])
    upper = np.array([description.joints[name].upper for name in model.names[1:]])
    request = coal.CollisionRequest()
    for _ in range(SAMPLES):
        if not len(table):
            break
        q = rng.uniform(lower, upper)
        pin.updateGeometryPlacements(model, data, geometry, geometry_data, q)
        placements = [coal.Transform3s(T.rotation, T.translation) for T in geometry_data.oMg]
        colliding = np.zeros(len(numbers), dtype=np.bool_)
        for i, j, number in table[_near(table, geometry_data.oMg, centers, radii)].tolist():
            colliding[number] = colliding[number] or coal.collide(
                shapes[i], placements[i], shapes[j], placements[j], request, coal.CollisionResult()
            )
        free += ~colliding
        table = table[free[table[:, 2]] <= (1.0 - ALWAYS) * SAMPLES]
    left = set(table[:, 2].tolist())
    return {p for p, number in numbers.items() if number in left}


def _near(
    table: npt.NDArray[np.int64], placements: Iterable[pin.SE3], centers: Array, radii: Array
) -> npt.NDArray[np.bool_]:
    """Of which rows the balls around both objects meet; others cannot collide."""
    at = np.array([T.act(c) for T, c in zip(placements, centers, strict=True)])
    first, second = table[:, 0], table[:, 1]
    apart = np.linalg.norm(at[first] - at[second], axis=1)
    return np.asarray(apart <= (radii[first] + radii[second]) * (1.0 + 1e-9) + 1e-9)
