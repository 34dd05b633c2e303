"""Four kinds of worlds, each drawn by a seed."""

from __future__ import annotations

import re
from collections.abc import Callable
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.household import OBJECT_NAMES, object_by_name
from benchmarks.worlds.world import (
    AROUND,
    BESIDES,
    GREY,
    World,
    distance,
    held_solids,
    random_turn,
    robot_solids,
    seen_parts,
    some_scene,
    start_of,
    with_round_links,
    yumi_at,
    yumi_urdf,
)
from placement_planner_ros.scenes.primitives import ConvexPrimitive, box, frustum
from placement_planner_ros.scenes.scenes import Scene

_ROD_GAPS_M, _LINK_GAPS_M = (0.003, 0.02), (0.003, 0.04)
"""From the held object to a rod, and from a link to a thing beside it."""
_OFF_M, _ORDINARY_M = 0.015, (0.003, 0.005)
"""By which a camera is off, and by which calibrated ones are."""
_ACCELERATION = 5.0
"""rad/s² of joints of which nobody states it."""
_FURNITURE = """<link name="table"><collision><origin xyz="{x} {y} {z}"/><geometry>
<box size="{sides}"/></geometry></collision></link><joint name="table_stands" type="fixed">
<parent link="yumi_body"/><child link="table"/></joint></robot>"""


def beside(rng: np.random.Generator) -> World:
    """A thing beside what is held, beside a link, or on furniture of the description."""
    thing, arm, grasp = _held(rng)
    urdf = yumi_urdf() if rng.random() < 0.5 else with_round_links(yumi_urdf(), rng)
    robot, q = yumi_at(thing, arm, urdf)
    moving = [*robot_solids(robot, q), *held_solids(robot, q, thing, arm, grasp)]
    where = str(rng.choice(["held", "link", "furniture"]))
    scene = some_scene(rng, f"beside_{where}")
    if where == "furniture":
        lower, upper = (corner(scene.parts[0].vertices, axis=0) for corner in (np.min, np.max))
        x, y, z = (lower + upper) / 2
        sides = " ".join(f"{side:.6f}" for side in upper - lower)
        told = urdf.replace("</robot>", _FURNITURE.format(x=x, y=y, z=z, sides=sides))
    else:
        told, extra = urdf, _thing_beside(rng, where, moving)
        scene = Scene(scene.name, scene.volume, (*scene.parts, extra))
    parts = seen_parts(scene, moving, rng, AROUND if rng.random() < 0.5 else ())
    return World("beside", scene.name, scene, thing, arm, grasp, parts, told, urdf)


def limits(rng: np.random.Generator) -> World:
    """Limits by `<safety_controller>`, by MoveIt's file, or of accelerations in the URDF."""
    thing, arm, grasp = _held(rng)
    robot, q = yumi_at(thing, arm)
    start, how = start_of(thing, arm), str(rng.choice(["safety", "moveit", "accelerations"]))
    told, true = (ElementTree.fromstring(yumi_urdf()) for _ in range(2))
    lines, accelerations = ["joint_limits:"], dict[str, float]()
    for joint, real in zip(told.iter("joint"), true.iter("joint"), strict=True):
        name, limit, true_limit = str(joint.get("name")), joint.find("limit"), real.find("limit")
        if limit is None or true_limit is None or not name.startswith("yumi_joint_"):
            continue
        accelerations[name] = _ACCELERATION
        low, high, at = float(limit.get("lower", 0)), float(limit.get("upper", 0)), start[name]
        if how != "accelerations" and rng.random() < 0.6:
            low += float(rng.uniform(0.0, 0.5)) * max(at - 0.2 - low, 0.0)
            high -= float(rng.uniform(0.0, 0.5)) * max(high - at - 0.2, 0.0)
            true_limit.set("lower", repr(low))
            true_limit.set("upper", repr(high))
            if how == "safety":
                told_of = {"soft_lower_limit": repr(low), "soft_upper_limit": repr(high)}
                gains = {"k_position": "100", "k_velocity": "10"}
                ElementTree.SubElement(joint, "safety_controller", told_of | gains)
        if how == "accelerations":
            accelerations[name] = float(rng.uniform(1.0, 8.0))
            limit.set("acceleration", repr(accelerations[name]))
        if how == "moveit":
            accelerations[name] = float(rng.uniform(1.0, 8.0))
            speed = float(rng.uniform(0.3, 1.0)) * float(limit.get("velocity", 1.0))
            true_limit.set("velocity", repr(speed))
            lines += [
                f"  {name}:",
                "    has_position_limits: true",
                f"    min_position: !degrees {float(np.rad2deg(low))!r}",
                f"    max_position: !degrees {float(np.rad2deg(high))!r}",
                "    has_velocity_limits: true",
                f"    max_velocity: {speed!r}",
                "    has_acceleration_limits: true",
                f"    max_acceleration: {accelerations[name]!r}",
            ]
    scene = some_scene(rng, f"limits_{how}")
    moving = [*robot_solids(robot, q), *held_solids(robot, q, thing, arm, grasp)]
    parts = seen_parts(scene, moving, rng)
    texts = [_with_version(ElementTree.tostring(root, "unicode"), how) for root in (told, true)]
    file = "\n".join(lines) if how == "moveit" else ""
    return World(
        "limits", scene.name, scene, thing, arm, grasp, parts, texts[0],
        ElementTree.tostring(true, "unicode"), file, accelerations,
    )  # fmt: skip


def quaternions(rng: np.random.Generator) -> World:
    """Most origins as quat_xyzw."""
    thing, arm, grasp = _held(rng)
    robot, q = yumi_at(thing, arm)
    root = ElementTree.fromstring(yumi_urdf())
    for origin in root.iter("origin"):
        if rng.random() < 0.7:
            angles = [float(word) for word in origin.attrib.pop("rpy", "0 0 0").split()]
            turn = Rotation.from_euler("xyz", angles).as_quat()
            length = 1.0 if rng.random() < 0.7 else rng.uniform(0.5, 2.0)
            origin.set("quat_xyzw", " ".join(repr(float(length * part)) for part in turn))
    told = _with_version(ElementTree.tostring(root, "unicode"), "1.1")
    scene = some_scene(rng, "quaternions")
    moving = [*robot_solids(robot, q), *held_solids(robot, q, thing, arm, grasp)]
    parts = seen_parts(scene, moving, rng)
    return World("quaternions", scene.name, scene, thing, arm, grasp, parts, told, yumi_urdf())


def cameras(rng: np.random.Generator) -> World:
    """Two cameras, one off by 15 mm, mostly up or down; a third of them as calibrated ones are."""
    thing, arm, grasp = _held(rng)
    urdf = yumi_urdf() if rng.random() < 0.5 else with_round_links(yumi_urdf(), rng)
    robot, q = yumi_at(thing, arm, urdf)
    ordinary = bool(rng.random() < 1.0 / 3.0)
    way = random_turn(rng)[:, 0]
    if ordinary:
        shift = rng.uniform(*_ORDINARY_M) * way
    else:
        way = np.array([*(0.4 * way[:2]), np.sign(way[2])])
        shift = _OFF_M * way / np.linalg.norm(way)
    scene = some_scene(rng, "cameras_" + ("ordinary" if ordinary else "off"))
    moving = [*robot_solids(robot, q), *held_solids(robot, q, thing, arm, grasp)]
    parts = seen_parts(scene, moving, rng, BESIDES, shift)
    words = "cameras", scene.name, scene, thing, arm, grasp, parts, urdf, urdf
    return World(*words, must_place=ordinary)


KINDS: dict[str, Callable[[np.random.Generator], World]] = {
    "beside": beside,
    "limits": limits,
    "quaternions": quaternions,
    "cameras": cameras,
}


def _held(rng: np.random.Generator) -> tuple[str, str, int]:
    """Thing, arm and grasp."""
    thing, arm = str(rng.choice(OBJECT_NAMES)), str(rng.choice(["left", "right"]))
    return thing, arm, int(rng.integers(len(object_by_name(thing).grasps[arm])))


def _thing_beside(
    rng: np.random.Generator, where: str, moving: list[ConvexPrimitive]
) -> ConvexPrimitive:
    """A rod beside the held object, or a small thing beside a link, which meets nothing."""
    links = [solid for solid in moving if not _is_held(solid)]
    held = [solid for solid in moving if _is_held(solid)]
    while True:
        beside = held if where == "held" else links
        solid = beside[int(rng.integers(len(beside)))]
        at = solid.vertices[int(rng.integers(len(solid.vertices)))]
        outward = at - solid.vertices.mean(axis=0)
        outward /= np.linalg.norm(outward)
        if where == "held":
            outward[2] = 0.0
            radius, top = rng.uniform(0.002, 0.006), at[2] + rng.uniform(0.0, 0.1)
            middle = at + (rng.uniform(*_ROD_GAPS_M) + radius) * outward
            if top < 0.02:
                continue
            made = frustum("extra", (radius, radius), (0.0, float(top)), GREY, middle[:2], 12)
        else:
            half = rng.uniform(0.005, 0.03, 3)
            middle = at + (rng.uniform(*_LINK_GAPS_M) + half.max()) * outward
            made = box("extra", (middle - half).tolist(), (middle + half).tolist(), GREY)
        least = _ROD_GAPS_M[0] if where == "held" else _LINK_GAPS_M[0]
        if min(distance(made, other) for other in moving) >= least:
            return made


def _is_held(solid: ConvexPrimitive) -> bool:
    return solid.name.split("/")[0] in OBJECT_NAMES


def _with_version(urdf: str, how: str) -> str:
    """The robot element with the version in which that is told."""
    version = {"1.1": "1.1", "accelerations": "1.2"}.get(how)
    if version is None:
        return urdf
    return re.sub(r"<robot ", f'<robot version="{version}" ', urdf, count=1)
