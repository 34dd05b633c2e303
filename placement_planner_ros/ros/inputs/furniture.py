"""Furniture in a description: links that are fixed, and no part of what the robot stands on."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.collision.shapes import shape_triangles
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.robot.overlap import Overlaps
from placement_planner_ros.core.types import Array, Mask
from placement_planner_ros.core.weak_cache import weak_lru_cache
from placement_planner_ros.ros.inputs.known_surface import KnownSurface
from placement_planner_ros.ros.inputs.self_filter import OWN_M

WORLD_LINKS = "world_links"
"""The parameter that names furniture."""

SAMPLES = 20
"""Configurations at which a moving link must be beside a fixed one."""


@dataclass(frozen=True, slots=True, eq=False)
class FixedLinks:
    """The links with shapes that no joint moves.

    Attributes:
        robot: the robot, without the shapes of its furniture.
        furniture, foot: links that are, and are no, part of the surroundings.
        surfaces: of each link of `furniture`.
    """

    robot: Robot
    furniture: tuple[str, ...]
    foot: tuple[str, ...]
    surfaces: tuple[KnownSurface, ...]

    def __str__(self) -> str:
        own = ", ".join(self.foot) or "none"
        return (
            f"links that no joint moves: {', '.join(self.furniture) or 'none'} are furniture, "
            f"obstacle and support; {own} are the robot's ({WORLD_LINKS} names furniture instead)"
        )


@weak_lru_cache("robot", maxsize=4)
def fixed_links(robot: Robot, ends: tuple[str, ...], named: tuple[str, ...] = ()) -> FixedLinks:
    """Tell furniture from the robot's foot; remembered, so that what is made of it is made once.

    Of the foot is, on each chain from the root to an end, the link that carries the first joint,
    and fixed links that this one, or a moving one, touches in every configuration, sampled.

    Args:
        ends: links that arms and sensors have at their ends.
        named: the links that are furniture, instead of those found.
    """
    joints = [shape.parentJoint for shape in robot.geometry.geometryObjects]
    pairs = zip(robot.geometry_links, joints, strict=True)
    # joint 0 is pinocchio's universe: nothing moves what hangs on it
    fixed = tuple(dict.fromkeys(link for link, joint in pairs if joint == 0))
    foot = frozenset(fixed).difference(named) if named else _foot(robot, ends, fixed)
    furniture = tuple(link for link in fixed if link not in foot)
    surfaces = tuple(KnownSurface(_surface(robot, link)) for link in furniture)
    own = tuple(link for link in fixed if link in foot)
    return FixedLinks(_without(robot, furniture), furniture, own, surfaces)


def _foot(robot: Robot, ends: Sequence[str], fixed: Sequence[str]) -> frozenset[str]:
    """Those of the fixed links that belong to the robot."""
    model, links = robot.model, np.array(robot.geometry_links)
    carrying = set()
    # the link that carries the first joint on each chain
    for end in ends:
        joint = model.frames[robot.frame_id(end)].parentJoint
        while joint != 0 and model.parents[joint] != 0:
            joint = model.parents[joint]
        if joint != 0:
            frame = model.getFrameId(model.names[joint], pin.FrameType.JOINT)
            carrying.add(model.frames[model.frames[frame].parentFrame].name)
    others = [link for link in fixed if link not in carrying]
    if not others:
        return frozenset(carrying)
    overlaps, rng = Overlaps(robot), np.random.default_rng(0)
    placements = robot.geometry_poses(np.zeros(model.nq))

    def rows(of: Mask, link: str) -> list[tuple[int, int]]:
        mine = np.flatnonzero(links == link)
        return [(i, j) for i in np.flatnonzero(of).tolist() for j in mine.tolist()]

    foot = set(carrying)
    for link in others:
        # fixed links that reach into that one are the foot it stands on
        near = rows(np.isin(links, list(carrying)), link)
        if any(
            overlaps.depth(i, j, placements[i], placements[j], beyond=OWN_M) > 0.0 for i, j in near
        ):
            foot.add(link)
    # what moves must touch it at every sample, or be so near that no arm could leave; most are not
    beside = CollisionSettings().clear
    moving = [shape.parentJoint != 0 for shape in robot.geometry.geometryObjects]
    touched = {link: set(links[moving].tolist()) for link in others if link not in foot}
    for _ in range(SAMPLES):
        q = robot.with_positions(np.zeros(model.nq), _drawn(robot, rng))
        placements = robot.geometry_poses(q)
        # only links that touched it in every configuration before are left to look at
        for link, by in touched.items():
            near = rows(np.isin(links, list(by)), link)
            touched[link] = {
                str(links[i])
                for i, j in near
                if overlaps.meet(i, j, placements[i], placements[j], beside)
            }
    return frozenset(foot.union(link for link, by in touched.items() if by))


def _drawn(robot: Robot, rng: np.random.Generator) -> dict[str, float]:
    """Values of all joints that follow no other."""
    # of joints without end stops one turn is enough
    low, high = (np.clip(limits, -np.pi, np.pi) for limits in (robot.lower, robot.upper))
    values = dict(zip(robot.joint_names, rng.uniform(low, high).tolist(), strict=True))
    return {name: value for name, value in values.items() if name not in robot.mimics}


def _without(robot: Robot, links: Collection[str]) -> Robot:
    """The robot without the shapes of some links; another one than it, which what is remembered of
    it may hold."""
    rows = [i for i, link in enumerate(robot.geometry_links) if link not in links]
    geometry = robot.geometry.copy()
    for shape, link in zip(robot.geometry.geometryObjects, robot.geometry_links, strict=True):
        if link in links:
            geometry.removeGeometryObject(shape.name)
    return replace(
        robot,
        geometry=geometry,
        geometry_links=tuple(robot.geometry_links[row] for row in rows),
        meshes=tuple(robot.meshes[row] for row in rows),
    )


def _surface(robot: Robot, link: str) -> Array:
    """(t, 3, 3) triangles of a fixed link, where it is, metres."""
    shapes = zip(
        robot.geometry.geometryObjects, robot.geometry_links, shape_triangles(robot), strict=True
    )
    placed = ((shape.placement, corners) for shape, of, corners in shapes if of == link)
    return np.vstack([corners @ T.rotation.T + T.translation for T, corners in placed])
