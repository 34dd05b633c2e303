"""The bundled objects have the paper's sizes, and the YuMi can hold and place them."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import checker
import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.scenes.objects import (
    BUNDLED_OBJECTS,
    GraspedObject,
    object_by_name,
)
from placement_planner_ros.scenes.yumi import (
    GRIPPER_OPEN,
    START_CONFIGURATION,
)

ROOT = Path(__file__).resolve().parents[2]
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


@pytest.fixture(scope="module", params=BUNDLED_OBJECTS)
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
    pieces = checker.object_pieces(thing.vertices, thing.triangles)
    assert len(pieces) == len(thing.parts)
    assert all(piece.solid for piece in pieces)
    signed = np.linalg.det(thing.vertices[thing.triangles]).sum() / 6
    assert signed == pytest.approx(sum(ConvexHull(p.corners.reshape(-1, 3)).volume for p in pieces))
    assert thing.vertices.min(axis=0)[2] <= thing.center_of_mass[2] <= thing.vertices[:, 2].max()
    centres = np.vstack([checker.piece_voxels([piece], 0.0021) for piece in pieces])
    inside = sum(part.depth(centres) > 1e-9 for part in thing.parts)
    assert inside.max() == 1


def test_fingers_touch_and_the_palm_is_clear(thing: GraspedObject) -> None:
    hand, opened = hand_solids(thing.finger_opening), hand_solids(GRIPPER_OPEN)
    assert len(hand) == 3
    for grasp in thing.grasps["left"]:
        assert distance(thing, grasp, hand["gripper_l_base"]) > 0.004
        for finger in ("gripper_l_finger_l", "gripper_l_finger_r"):
            assert -0.0005 < distance(thing, grasp, hand[finger]) <= 0
            assert distance(thing, grasp, opened[finger]) > 0.005
