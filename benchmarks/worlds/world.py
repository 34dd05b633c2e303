"""A true world, and what its robot's description and its cameras say of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin
import trimesh
from scipy.spatial.transform import Rotation

from benchmarks.household import object_by_name
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.problem import workspace
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.ros.inputs.cloud_store import PointSet
from placement_planner_ros.ros.inputs.furniture import fixed_links
from placement_planner_ros.ros.inputs.joint_limits_file import parse_joint_limits
from placement_planner_ros.ros.parameters.table import arm_specs, arms_spec, fixed_specs
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.scenes.clouds import (
    CameraNoise,
    DepthCamera,
    camera_clouds,
    complete_cloud,
)
from placement_planner_ros.scenes.primitives import (
    Colour,
    ConvexPrimitive,
    box,
    frustum,
    standing_box,
)
from placement_planner_ros.scenes.scenes import Scene
from placement_planner_ros.scenes.yumi import TIP_FRAMES, start_configuration, yumi_arm
from placement_planner_ros.share import PACKAGE, share_path

GREY: Colour = (0.6, 0.6, 0.6)
_TABLE = (0.139, -0.426, -0.04), (0.695, 0.474, 0.0)
BESIDES = ((0.3, 1.1, 0.9), (0.3, -1.1, 0.9))
"""Eyes of cameras left and right of the table, m ..."""
AROUND = (*BESIDES, (1.2, 0.0, 1.0))
"""... and of one more, across from the robot."""
_LOOKED_AT = (0.35, 0.0, 0.15)
_NOISE_M = 0.0005
"""Of points that no camera took."""


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """What is true, and what is told.

    Attributes:
        kind, name: for tables.
        scene: all true solids, and V.
        thing, arm, grasp: what is held, and how.
        parts: what the sensors say of it, the robot and the object included.
        urdf: of the robot, as it is told.
        true_urdf: that of the checker; without furniture, which is among the solids.
        joint_limits: MoveIt's file; empty for none.
        accelerations: rad/s² at most by joint; of joints that are not named the default's.
        must_place: whether it counts where nothing is placed though something could be.
    """

    kind: str
    name: str
    scene: Scene
    thing: str
    arm: str
    grasp: int
    parts: tuple[PointSet, ...]
    urdf: str
    true_urdf: str
    joint_limits: str = ""
    accelerations: Mapping[str, float] = field(default_factory=dict)
    must_place: bool = True

    def snapshot(self, seed: int) -> Snapshot:
        """As the node takes it."""
        held = object_by_name(self.thing)
        specs = [*fixed_specs(), arms_spec([self.arm]), *arm_specs(self.arm, yumi=True)]
        volume = self.scene.volume
        parameters = ParameterSet({spec.name: spec for spec in specs}).changed(
            {"target_volume": [*volume.lower.tolist(), *volume.upper.tolist()], "seed": seed}
        )
        robot = _read_robot(self.urdf, self.joint_limits)
        q = robot.configuration(start_of(self.thing, self.arm))
        fixed = fixed_links(robot, tuple(TIP_FRAMES.values()))
        arms = (yumi_arm(fixed.robot, self.arm, held.grasps[self.arm]),)
        body = Body.from_mesh(held.vertices, held.triangles, held.center_of_mass)
        around = workspace(fixed.robot, arms, q, body, volume)
        known = [surface.within(*around) for surface in fixed.surfaces]
        parts = (*self.parts, *(each for each in known if len(each.points)))
        return Snapshot(fixed.robot, arms, q, body, parts, parameters, robot.root_link)


def yumi_urdf() -> str:
    """The bundled robot's description."""
    return share_path("urdf", "yumi.urdf").read_text(encoding="utf-8")


def yumi_srdf() -> str:
    """The bundled robot's semantic description."""
    return share_path("urdf", "yumi.srdf").read_text(encoding="utf-8")


def start_of(thing: str, arm: str) -> dict[str, float]:
    """Where the robot stands: in the paper's start, with that hand closed on the object."""
    return start_configuration(thing, arm)


def some_scene(rng: np.random.Generator, name: str) -> Scene:
    """The bundled table with two to six things at random, and V on a part of it."""
    (low_x, low_y, _), (high_x, high_y, _) = _TABLE
    parts = [box("table", *_TABLE, GREY)]
    taken: list[tuple[float, float, float]] = []
    for number in range(int(rng.integers(2, 7))):
        x, y = rng.uniform(low_x + 0.08, high_x - 0.08), rng.uniform(low_y + 0.08, high_y - 0.08)
        radius, height = rng.uniform(0.02, 0.06), rng.uniform(0.03, 0.2)
        if any(np.hypot(x - a, y - b) < radius + r + 0.01 for a, b, r in taken):
            continue
        taken.append((x, y, radius))
        if rng.random() < 0.5:
            parts.append(frustum(f"can_{number}", (radius, radius), (0.0, height), GREY, (x, y)))
        else:
            sides = (1.3 * radius, rng.uniform(0.5, 1.4) * radius, height)
            turn = rng.uniform(-np.pi, np.pi)
            parts.append(standing_box(f"box_{number}", sides, (x, y), turn, 0.0, GREY))
    side = 1.0 if rng.random() < 0.5 else -1.0
    middle = np.array([rng.uniform(0.34, 0.44), side * rng.uniform(0.0, 0.16), 0.0])
    half = np.array([0.14, 0.18, 0.05])
    return Scene(name, TargetVolume(middle - half, middle + half), tuple(parts))


def with_round_links(urdf: str, rng: np.random.Generator) -> str:
    """The bundled robot with a ball, cylinder or capsule in place of each mesh of its arms."""
    root = ElementTree.fromstring(urdf)
    for collision in root.iter("collision"):
        geometry = collision[-1]
        mesh = geometry[0].get("filename", "").rpartition("/")[2]
        if not mesh.startswith("link_"):
            continue
        corners = trimesh.load_mesh(share_path("urdf", "meshes", mesh)).vertices
        T_box_mesh, sides = trimesh.bounds.oriented_bounds(corners, ordered=True)
        T_mesh_box = np.linalg.inv(T_box_mesh)
        radius, kind = sides[0] / 2, str(rng.choice(["sphere", "cylinder", "capsule"]))
        geometry[:] = [ElementTree.Element(kind, radius=repr(float(radius)))]
        if kind != "sphere":
            length = sides[2] - 2 * radius * (kind == "capsule")
            geometry[0].set("length", repr(float(max(length, 0.001))))
        at = T_mesh_box[:3, 3], pin.rpy.matrixToRpy(T_mesh_box[:3, :3])
        xyz, rpy = (" ".join(map(repr, each.tolist())) for each in at)
        collision.insert(0, ElementTree.Element("origin", xyz=xyz, rpy=rpy))
    return ElementTree.tostring(root, "unicode")


def robot_solids(robot: Robot, q: Array) -> list[ConvexPrimitive]:
    """The robot's links at q (nq,)."""
    solids = []
    for shape, T, link in zip(
        robot.geometry.geometryObjects, robot.geometry_poses(q), robot.geometry_links, strict=True
    ):
        vertices = _corners(shape.geometry) @ T.rotation.T + T.translation
        solids.append(ConvexPrimitive(link, vertices))
    return solids


def _corners(shape: coal.CollisionGeometry) -> Array:
    """(n, 3) of a convex mesh, or of one within a round shape."""
    if isinstance(shape, coal.ConvexBase):
        return np.array(shape.points())
    if isinstance(shape, coal.Sphere):
        return np.asarray(trimesh.creation.icosphere(radius=shape.radius).vertices)
    make = getattr(trimesh.creation, type(shape).__name__.lower())
    return np.asarray(make(height=2 * shape.halfLength, radius=shape.radius).vertices)


def held_solids(robot: Robot, q: Array, thing: str, arm: str, grasp: int) -> list[ConvexPrimitive]:
    """The parts of the object in the hand."""
    held = object_by_name(thing)
    T = robot.link_pose(q, TIP_FRAMES[arm]) * held.grasps[arm][grasp]
    return [
        ConvexPrimitive(part.name, part.vertices @ T.rotation.T + T.translation)
        for part in held.parts
    ]


def distance(one: ConvexPrimitive, other: ConvexPrimitive) -> float:
    """Metres between two solids; negative or 0 where they meet."""
    shapes = [_coal_convex(each.vertices) for each in (one, other)]
    still = coal.Transform3s.Identity()
    result = coal.DistanceResult()
    return float(coal.distance(shapes[0], still, shapes[1], still, coal.DistanceRequest(), result))


def _coal_convex(vertices: Array) -> coal.ConvexBase:
    points = coal.StdVec_Vec3s()
    points.extend(list(np.asarray(vertices)))
    return coal.ConvexBase.convexHull(points, False, "")


def seen_parts(
    scene: Scene,
    moving: Sequence[ConvexPrimitive],
    rng: np.random.Generator,
    eyes: Sequence[tuple[float, float, float]] = (),
    shift: Array | None = None,
) -> tuple[PointSet, ...]:
    """What cameras see of the scene and of what moves, or all of their surfaces.

    Args:
        moving: robot and object.
        eyes: places of cameras, whose noise is 1 to 2 mm; none for all of the surfaces.
        shift: (3,) by which the second camera is thought to be elsewhere, metres.
    """
    if not eyes:
        solids = Scene(scene.name, scene.volume, (*scene.parts, *moving))
        points = complete_cloud(solids)
        return (PointSet(points + rng.normal(0.0, _NOISE_M, points.shape)),)
    noise = CameraNoise(range_deviation=float(rng.uniform(0.001, 0.002)))
    parts = []
    cameras = [DepthCamera.looking_at(f"camera_{k}", eye, _LOOKED_AT) for k, eye in enumerate(eyes)]
    clouds = camera_clouds(scene, rng, extra=moving, cameras=cameras, noise=noise)
    for number, cloud in enumerate(clouds):
        off = np.zeros(3) if shift is None or number == 0 else shift
        origin = cloud.camera.T_world_camera.translation + off
        points = cloud.world_points() + off
        parts.append(PointSet(points, origin, topic=f"camera_{number}/points", time=1.0))
    return tuple(parts)


def random_turn(rng: np.random.Generator) -> Array:
    """(3, 3) any rotation."""
    return np.asarray(Rotation.random(random_state=int(rng.integers(2**31))).as_matrix())


def _read_robot(urdf: str, limits: str = "") -> Robot:
    folder = share_path("urdf", "yumi.urdf").parent.parent
    return Robot.from_urdf(urdf, {PACKAGE: folder}, yumi_srdf(), parse_joint_limits(limits))


def yumi_at(thing: str, arm: str, urdf: str = "") -> tuple[Robot, Array]:
    """The bundled robot, by the description given or its own, and q_0 (nq,)."""
    robot = _read_robot(urdf or yumi_urdf())
    return robot, robot.configuration(start_of(thing, arm))
