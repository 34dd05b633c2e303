"""The bundled objects have the paper's sizes, and the YuMi can hold and place them."""

from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import checker
import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from scipy.spatial import ConvexHull

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.scenes.objects import (
    OBJECT_NAMES,
    SINGLE_MESHES,
    GraspedObject,
    object_by_name,
)
from placement_planner_ros.scenes.scenes import SCENE_NAMES, Scene, scene_by_name
from placement_planner_ros.scenes.yumi import (
    GRIPPER_JOINTS,
    GRIPPER_OPEN,
    START_CONFIGURATION,
    load_yumi,
    yumi_arm,
)

ROOT = Path(__file__).resolve().parents[2]
ARMS = ("left", "right")
PAD_LOWER, PAD_UPPER = np.array([-0.001, -0.0104, 0.0837]), np.array([0.001, 0.0104, 0.1359])
"""Where, in the tip frame, the finger pads are, but for their opening in x."""


@dataclass(frozen=True)
class Face:
    """A facet of the object's hull that it can stand on: normal . x = offset."""

    normal: np.ndarray
    offset: float


def faces_of(thing: GraspedObject) -> list[Face]:
    """Hull facets with the projected centre of mass at least 9 mm inside."""
    planes: list[np.ndarray] = []
    for plane in ConvexHull(thing.vertices).equations:
        if not any(np.abs(plane - other).max() < 1e-6 for other in planes):
            planes.append(plane)
    faces = []
    for plane in planes:
        normal, offset = plane[:3], -plane[3]
        corners = thing.vertices[np.abs(thing.vertices @ normal - offset) < 1e-6]
        u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        axes = np.column_stack([u / np.linalg.norm(u), np.cross(normal, u / np.linalg.norm(u))])
        outline = ConvexHull(corners @ axes).equations
        if (outline[:, :2] @ (thing.center_of_mass @ axes) + outline[:, 2]).max() < -0.009:
            faces.append(Face(normal, float(offset)))
    return faces


@cache
def reader() -> checker.RobotModel:
    return checker.RobotModel.read(
        (ROOT / "urdf/yumi.urdf").read_text(),
        (ROOT / "urdf/yumi.srdf").read_text(),
        {"placement_planner_ros": ROOT},
    )


def hand_solids(opening: float) -> dict[str, np.ndarray]:
    """Vertices (n, 3) of the left hand's links in the tip frame."""
    robot = reader()
    q = robot.configuration({**START_CONFIGURATION, "gripper_l_joint": opening})
    data, geometry = robot.model.createData(), robot.geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.geometry, geometry, q)
    T_tip_world = pin.SE3(robot.frame_pose(q, "gripper_l_base")).inverse()
    solids = {}
    for thing, T_world_solid in zip(robot.geometry.geometryObjects, geometry.oMg, strict=True):
        link = robot.model.frames[thing.parentFrame].name
        if link.startswith("gripper_l"):
            T = T_tip_world * T_world_solid
            points = np.array(thing.geometry.points())
            solids[link] = points @ T.rotation.T + T.translation
    return solids


def distance(thing: GraspedObject, T: pin.SE3, solid: np.ndarray) -> float:
    """Between the object at T and a solid's hull, negative inside, metres."""
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    pose = coal.Transform3s(T.rotation, T.translation)
    return min(
        coal.distance(
            checker.convex(part.vertices),
            pose,
            checker.convex(solid),
            coal.Transform3s(),
            request,
            coal.DistanceResult(),
        )
        for part in thing.parts
    )


@pytest.fixture(scope="module", params=OBJECT_NAMES)
def thing(request: pytest.FixtureRequest) -> GraspedObject:
    return object_by_name(request.param)


def test_names_are_refused_with_those_there_are() -> None:
    with pytest.raises(ParameterError, match="wine_glass"):
        object_by_name("wineglass")


@pytest.mark.parametrize(
    ("name", "size", "faces"),
    [
        ("large_crayons_box", (0.144, 0.124, 0.036), 6),
        ("small_crayons_box", (0.094, 0.021, 0.071), 6),
        ("wine_glass", (0.084, 0.084, 0.145), 2),
        ("toy_table", (0.110, 0.070, 0.073), 6),
    ],
)
def test_sizes_and_faces_are_the_papers(name: str, size: tuple, faces: int) -> None:
    thing = object_by_name(name)
    np.testing.assert_allclose(np.ptp(thing.vertices, axis=0), size, atol=1e-9)
    assert len(faces_of(thing)) == faces


def test_meshes_are_convex_solids_that_touch_but_do_not_overlap(thing: GraspedObject) -> None:
    components = checker.convex_components(thing.vertices, thing.triangles)
    assert len(components) == len(thing.parts)
    signed = np.linalg.det(thing.vertices[thing.triangles]).sum() / 6
    assert signed == pytest.approx(sum(ConvexHull(c).volume for c in components))
    assert thing.vertices.min(axis=0)[2] <= thing.center_of_mass[2] <= thing.vertices[:, 2].max()
    centres = [voxels for c in components for voxels in checker.voxel_centres([c], 0.0021)]
    inside = sum(part.depth(np.array(centres)) > 1e-9 for part in thing.parts)
    assert inside.max() == 1


@pytest.mark.parametrize("name", SINGLE_MESHES)
def test_single_meshes_are_the_closed_surface_of_the_same_solids(name: str) -> None:
    surface, solids = object_by_name(name), object_by_name(name.removesuffix("_mesh"))
    made = trimesh.Trimesh(surface.vertices, surface.triangles, process=False)
    assert made.is_volume
    assert made.body_count == 1
    np.testing.assert_allclose(made.bounds[0], solids.vertices.min(axis=0), atol=1e-12)
    np.testing.assert_allclose(made.bounds[1], solids.vertices.max(axis=0), atol=1e-12)
    # the solids only touch each other
    assert made.volume == pytest.approx(sum(ConvexHull(p.vertices).volume for p in solids.parts))
    centres = made.triangles_center - 1e-6 * made.face_normals
    depth = np.max([part.depth(centres) for part in solids.parts], axis=0)
    assert depth.min() > 0
    assert np.max([part.depth(centres + 2e-6 * made.face_normals) for part in solids.parts]) < 0
    assert surface.grasps == solids.grasps


def test_fingers_touch_and_the_palm_is_clear(thing: GraspedObject) -> None:
    hand, opened = hand_solids(thing.finger_opening), hand_solids(GRIPPER_OPEN)
    assert len(hand) == 3
    for grasp in thing.grasps["left"]:
        assert distance(thing, grasp, hand["gripper_l_base"]) > 0.004
        for finger in ("gripper_l_finger_l", "gripper_l_finger_r"):
            assert -0.0005 < distance(thing, grasp, hand[finger]) <= 0
            assert distance(thing, grasp, opened[finger]) > 0.005


def test_the_object_fills_the_fingers(thing: GraspedObject) -> None:
    assert 2 * thing.finger_opening <= 0.048
    points = checker.voxel_centres([part.vertices for part in thing.parts], 0.0015)
    reach = np.array([thing.finger_opening, 0, 0])
    for grasp in thing.grasps["left"]:
        held = points @ grasp.rotation.T + grasp.translation
        held = held[((held > PAD_LOWER - reach) & (held < PAD_UPPER + reach)).all(axis=1)]
        assert np.ptp(held[:, 0]) == pytest.approx(2 * thing.finger_opening, abs=0.0031)
        assert np.ptp(held[:, 1:], axis=0).max() > 0.015


def test_grasps_are_the_same_for_both_arms(thing: GraspedObject) -> None:
    assert set(thing.grasps) == set(ARMS)
    assert 1 <= len(thing.grasps["left"]) <= 4
    assert thing.grasps["left"] == thing.grasps["right"]


def test_the_hand_stays_above_what_two_faces_stand_on(thing: GraspedObject) -> None:
    """Closed or open, by at least 5 mm."""
    hand = np.vstack(
        [v for o in (thing.finger_opening, GRIPPER_OPEN) for v in hand_solids(o).values()]
    )
    usable = 0
    for face in faces_of(thing):
        heights = []
        for grasp in thing.grasps["left"]:
            inverse = grasp.inverse()
            points = hand @ inverse.rotation.T + inverse.translation
            heights.append(face.offset - (points @ face.normal).max())
        usable += max(heights) >= 0.005
    assert usable >= 2


def placements(
    scene: Scene, thing: GraspedObject, face: Face, task: checker.Task, count: int
) -> list[np.ndarray]:
    """Poses (4, 4) of the object standing on a face, free of the scene, in V."""
    rng = np.random.default_rng(0)
    down = pin.Quaternion.FromTwoVectors(face.normal, np.array([0, 0, -1.0])).toRotationMatrix()
    low, high = scene.volume.lower, scene.volume.upper
    tops = [
        part
        for part in scene.parts
        if low[2] <= part.vertices[:, 2].max() <= high[2] and "wall" not in part.name
    ]
    area = np.array([np.prod(np.ptp(part.vertices[:, :2], axis=0)) for part in tops])
    solids = [(checker.convex(part.vertices), coal.Transform3s()) for part in scene.parts]
    object_solids = [checker.convex(part.vertices) for part in thing.parts]
    found: list[np.ndarray] = []
    for _ in range(20 * count):
        part = tops[rng.choice(len(tops), p=area / area.sum())]
        T = np.eye(4)
        T[:3, :3] = pin.utils.rotate("z", rng.uniform(-np.pi, np.pi)) @ down
        below = rng.uniform(part.vertices.min(axis=0), part.vertices.max(axis=0))[:2]
        T[:2, 3] = below - (T[:3, :3] @ thing.center_of_mass)[:2]
        T[2, 3] = part.vertices[:, 2].max() + 1e-4 + face.offset
        pose = coal.Transform3s(T[:3, :3], T[:3, 3])
        met = any(
            coal.collide(a, pose, b, T_b, coal.CollisionRequest(), coal.CollisionResult())
            for a in object_solids
            for b, T_b in solids
        )
        if not met and not checker.check_stance(task, T, checker.Tolerances()):
            found.append(T)
            if len(found) == count:
                break
    return found


@pytest.mark.parametrize(
    ("scene_name", "object_name"),
    [
        *((scene_name, "toy_table") for scene_name in SCENE_NAMES),
        *(("cabinet_high_clutter", name) for name in OBJECT_NAMES if name != "toy_table"),
    ],
)
def test_each_arm_can_place_on_two_faces(scene_name: str, object_name: str) -> None:
    """Some configuration is free of collisions, object in hand, standing on the face."""
    thing = object_by_name(object_name)
    scene, robot, rng = scene_by_name(scene_name), load_yumi(), np.random.default_rng(1)
    fingers = dict.fromkeys(GRIPPER_JOINTS.values(), thing.finger_opening)
    q_start = {**START_CONFIGURATION, **fingers}
    task = checker.Task.of(scene, thing, "", "", {}, q_start, "none")
    faces = faces_of(thing)
    poses = [placements(scene, thing, face, task, 40) for face in faces]
    q_start = reader().configuration(task.q_start)
    reached = Counter[str]()
    for name in ARMS:
        arm = yumi_arm(robot, name, thing.grasps[name])
        chain = Chain.from_robot(robot, arm, robot.configuration(task.q_start))
        ik = InverseKinematics(chain)
        columns = [reader().index[joint] for joint in arm.joints]
        for candidates in poses:
            if any(
                _reaches(task, arm, ik, columns, q_start, grasp, candidates, rng)
                for grasp in arm.grasps
            ):
                reached[name] += 1
    assert min(reached[name] for name in ARMS) >= 2, reached


def _reaches(task, arm, ik, columns, q_start, grasp, candidates, rng) -> bool:
    still = SimpleNamespace(joints=arm.joints)
    solution = checker.Solution(
        still, 0.0, np.eye(4), 0.0, arm.tip_frame, grasp.homogeneous, arm.touch_links
    )
    components = checker.object_pieces(task.object_vertices, task.object_triangles)
    world = checker.World.build(reader(), task, components, solution, checker.Tolerances().contact)
    model, shapes = reader().model, world.geometry.createData()
    data = model.createData()
    assert not pin.computeCollisions(model, data, world.geometry, shapes, q_start, True)
    for T_world_object in candidates:
        T_world_tip = T_world_object @ grasp.inverse().homogeneous
        for joints in ik.solve(T_world_tip, ik.random_seeds(rng, 8)):
            q = q_start.copy()
            q[columns] = joints
            if not pin.computeCollisions(model, data, world.geometry, shapes, q, True):
                return True
    return False
