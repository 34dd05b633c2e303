"""Every placement pose of a problem on a dense grid, and which of them the pose checks let pass."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.body.placement_face import PlacementFace
from placement_planner_ros.core.collision.object import ObjectCollision
from placement_planner_ros.core.errors import ParameterError
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.distance import ClearanceField
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.types import LEVEL, Array


@dataclass(frozen=True, slots=True)
class GridResolution:
    """How dense.

    Attributes:
        step: between positions, metres.
        turn: between angles, rad.
    """

    step: float = 0.005
    turn: float = math.radians(2.0)

    def __post_init__(self) -> None:
        if not self.step > 0.0:
            raise ParameterError("step", self.step, "must be above zero")
        if not 0.0 < self.turn <= 2.0 * math.pi:
            raise ParameterError("turn", self.turn, "must be above zero and at most a full turn")


@dataclass(frozen=True, slots=True, eq=False)
class GridPlacements:
    """Poses in V that are stable and free of collision.

    Attributes:
        face: (m,) index of the placement face.
        contact: (m, 3) position of its reference vertex, metres.
        angle: (m,) θ, rad.
        clearance: (m,) C(x), metres.
        tried: poses of the grid, feasible or not.
    """

    face: npt.NDArray[np.int64]
    contact: Array
    angle: Array
    clearance: Array
    tried: int


def region_grid(region: Region, step: float) -> Array:
    """(n, 3) points of a square lattice on the region, and each rectangle's middle."""
    points = []
    for (x0, y0, x1, y1), cut in zip(region.rectangles, region.diagonals, strict=True):
        x, y = np.meshgrid(_multiples(x0, x1, step), _multiples(y0, y1, step), indexing="ij")
        xy = np.vstack([np.column_stack([x.ravel(), y.ravel()]), [(x0 + x1) / 2, (y0 + y1) / 2]])
        plus, minus = xy[:, 0] + xy[:, 1], xy[:, 0] - xy[:, 1]
        on = (plus >= cut[0]) & (plus <= cut[1]) & (minus >= cut[2]) & (minus <= cut[3])
        points.append(xy[on])
    xy = np.unique(np.vstack(points), axis=0)
    return np.column_stack([xy, region.heights(xy)])


def grid_placements(
    problem: Problem, resolution: GridResolution, settings: PlannerSettings
) -> GridPlacements:
    """Check V, s(x) and c_f(x) at every grid pose of every face on every level region."""
    environment, body = problem.environment, problem.body
    collision = ObjectCollision(body, environment.obstacles, settings.collision)
    field = ClearanceField(environment.obstacles, problem.volume, beyond=0.0)
    found: list[tuple[Array, ...]] = []
    tried = 0
    for index, face, points, angle in _slices(problem, resolution):
        tried += len(points)
        T = _poses(face, points, angle)
        T = T[_in_volume(problem, T, points)]
        T = T[_stable(problem, face.vertices, T, settings)]
        z = points[0, 2]
        T = T[collision.free_at(T, z, settings.approach.approach_minimum)]
        if len(T) == 0:
            continue
        clearance, _ = field.mean_clearance_batch(T, body.volume_points)
        contact = T[:, :3, :3] @ face.vertices[0] + T[:, :3, 3]
        contact[:, 2] = z
        found.append((np.full(len(T), index), contact, np.full(len(T), angle), clearance))
    if not found:
        empty = np.empty(0)
        return GridPlacements(empty.astype(np.int64), np.empty((0, 3)), empty, empty, tried)
    faces, contacts, angles, clearances = (np.concatenate(column) for column in zip(*found))  # noqa: B905
    return GridPlacements(faces.astype(np.int64), contacts, angles, clearances, tried)


def _multiples(low: float, high: float, step: float) -> Array:
    return np.asarray(np.arange(math.ceil(low / step), math.floor(high / step) + 1) * step)


def _slices(
    problem: Problem, resolution: GridResolution
) -> Iterator[tuple[int, PlacementFace, Array, float]]:
    """Per face, region and angle: the face and the positions (n, 3) of its reference vertex."""
    angles = np.arange(0.0, 2.0 * math.pi - 1e-9, resolution.turn)
    for region in problem.environment.regions:
        if region.slope != LEVEL:
            continue
        points = region_grid(region, resolution.step)
        for index, face in enumerate(problem.body.faces):
            for angle in angles:
                yield index, face, points, float(angle)


def _poses(face: PlacementFace, points: Array, angle: float) -> Array:
    """(n, 4, 4) T(R_z(θ), point) · fT_o."""
    T = np.zeros((len(points), 4, 4))
    cos, sin = math.cos(angle), math.sin(angle)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    T[:, :3, :3] = turn @ face.T_face_object.rotation
    T[:, :3, 3] = points + turn @ face.T_face_object.translation
    T[:, 3, 3] = 1.0
    return T


def _in_volume(problem: Problem, T: Array, points: Array) -> npt.NDArray[np.bool_]:
    center = T[:, :3, :3] @ problem.body.center_of_mass + T[:, :3, 3]
    center[:, 2] = points[:, 2]
    return problem.volume.contains(points) & problem.volume.contains(center)


def _stable(
    problem: Problem, contacts: Array, T: Array, settings: PlannerSettings
) -> npt.NDArray[np.bool_]:
    vertices = T[:, None, :3, :3] @ contacts[None, :, :, None]
    vertices = vertices[..., 0] + T[:, None, :3, 3]
    supported = problem.environment.support.supported(
        vertices.reshape(-1, 3), settings.collision.contact_tolerance, settings.edge_margin
    )
    return np.asarray(supported.reshape(len(T), len(contacts)).all(axis=1))
