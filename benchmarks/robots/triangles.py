"""A robot's original triangles, to judge answers by without the planner's code.

The URDF is read by pinocchio, its meshes by assimp. Distances to triangles are by coal's trees;
what is inside of a closed component of a mesh is told by its winding number. Open components are
sheets.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """Connected triangles of a mesh.

    Attributes:
        corners: (t, 3, 3) of the triangles.
        closed: whether every edge belongs to two of them.
        low, high: (3,) of the box around them.
    """

    corners: Array
    closed: bool
    low: Array = field(init=False)
    high: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "low", self.corners.min(axis=(0, 1)))
        object.__setattr__(self, "high", self.corners.max(axis=(0, 1)))

    def encloses(self, point: Array) -> bool:
        """Whether a point (3,) is inside of what is closed."""
        if not self.closed or not ((point > self.low) & (point < self.high)).all():
            return False
        return bool(abs(winding_number(self.corners, point)) > 0.5)


def winding_number(corners: Array, point: Array) -> float:
    """How often triangles (t, 3, 3) wind around a point (3,)."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (corners - point).transpose(1, 2, 0)
    la, lb, lc = (
        np.sqrt(x * x + y * y + z * z) for x, y, z in ((ax, ay, az), (bx, by, bz), (cx, cy, cz))
    )
    volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    ab, bc = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz
    ca = cx * ax + cy * ay + cz * az
    whole = la * lb * lc + ab * lc + bc * la + ca * lb
    return float(np.arctan2(volume, whole).sum() / (2.0 * np.pi))


def components(vertices: Array, triangles: Triangles) -> tuple[Component, ...]:
    """The connected components of a mesh: vertices in the same place are one."""
    vertices, same = np.unique(vertices, axis=0, return_inverse=True)
    triangles = same.reshape(-1)[triangles]
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    graph = coo_matrix((np.ones(len(edges)), edges.T), (len(vertices),) * 2)
    label = connected_components(graph, directed=False)[1][triangles[:, 0]]
    found = []
    for each in np.unique(label):
        rows = np.flatnonzero(label == each)
        own = edges.reshape(-1, 3, 2)[rows].reshape(-1, 2)
        uses = np.unique(own, axis=0, return_counts=True)[1]
        found.append(Component(vertices[triangles[rows]], bool((uses == 2).all())))
    return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class LinkSolid:
    """One collision geometry of a link.

    Attributes:
        arm_joints: those of the arm that move it.
        shape: triangles, or a primitive.
        components: of a mesh; none of a primitive, which is solid.
        center, half: (3,) of the box around it, in its own frame.
        points: (k, 3) one of each component, in its own frame; its centre where it has none.
        closed: components that may hold something; `low`, `high` (c, 3) the boxes around them.
    """

    link: str
    arm_joints: frozenset[int]
    shape: coal.CollisionGeometry
    components: tuple[Component, ...]
    center: Array
    half: Array
    points: Array = field(init=False)
    closed: tuple[Component, ...] = field(init=False)
    low: Array = field(init=False)
    high: Array = field(init=False)

    def __post_init__(self) -> None:
        points = [each.corners[0, 0] for each in self.components] or [self.center]
        closed = tuple(each for each in self.components if each.closed)
        object.__setattr__(self, "points", np.array(points))
        object.__setattr__(self, "closed", closed)
        object.__setattr__(self, "low", np.array([each.low for each in closed]).reshape(-1, 3))
        object.__setattr__(self, "high", np.array([each.high for each in closed]).reshape(-1, 3))

    def encloses_any(self, points: Array) -> bool:
        """Whether one of points (n, 3), in its own frame, is inside of a closed component."""
        at = points[:, None]
        rows, columns = np.nonzero(((at > self.low) & (at < self.high)).all(axis=2))
        pairs = zip(rows.tolist(), columns.tolist(), strict=True)
        return any(self.closed[column].encloses(points[row]) for row, column in pairs)


class Boxes:
    """What an arm may be near: boxes along the axes, and a tree of their middles.

    Args:
        lower, upper: (n, 3) corners.
    """

    def __init__(self, lower: Array, upper: Array) -> None:
        self.middle, self.half = (lower + upper) / 2.0, (upper - lower) / 2.0
        self.radius = np.linalg.norm(self.half, axis=1)
        self._tree = cKDTree(self.middle)

    def within(self, points: Array, away: Array) -> list[npt.NDArray[np.int64]]:
        """Of each of points (k, 3): boxes of which some point may be within `away` (k,) of it."""
        found = self._tree.query_ball_point(points, away + self.radius.max(initial=0.0))
        return [np.array(rows, dtype=np.int64) for rows in found]


class TriangleRobot:
    """A robot at one configuration after the other.

    Args:
        urdf: its text.
        package_dirs: folders that hold the packages it names.
        arm_joints: names of the arm's joints.
        pairs: links that must not meet.
    """

    def __init__(
        self,
        urdf: str,
        package_dirs: Sequence[str | Path],
        arm_joints: Iterable[str],
        pairs: Iterable[frozenset[str]],
    ) -> None:
        text, self._mimics = _with_one_coordinate_each(urdf)
        self._model = pin.buildModelFromXML(text)
        folders = [str(folder) for folder in package_dirs]
        self._geometry = pin.buildGeomFromUrdfString(
            self._model, text, pin.COLLISION, None, folders
        )
        self._data, self._shapes = self._model.createData(), self._geometry.createData()
        arm = {self._model.getJointId(name) for name in arm_joints}
        self.things = [
            _link_solid(thing, self._model, arm) for thing in self._geometry.geometryObjects
        ]
        self._moving = [i for i, thing in enumerate(self.things) if thing.arm_joints]
        wanted = set(pairs)
        self._pairs = [
            (i, j)
            for i, one in enumerate(self.things)
            for j, other in enumerate(self.things[:i])
            if frozenset({one.link, other.link}) in wanted and one.arm_joints != other.arm_joints
        ]
        self._radii = np.array([np.linalg.norm(thing.half) for thing in self.things])

    def place(self, positions: Mapping[str, float]) -> None:
        """Move all joints that mimic no other, rad or m."""
        q = np.zeros(self._model.nq)
        index = {name: self._model.joints[i].idx_q for i, name in enumerate(self._model.names)}
        for name, value in positions.items():
            q[index[name]] = value
        for name, (master, factor, offset) in self._mimics.items():
            q[index[name]] = factor * q[index[master]] + offset
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._shapes, q)

    def placement(self, thing: int) -> pin.SE3:
        """Where a thing is now."""
        return self._shapes.oMg[thing]

    def near_boxes(self, boxes: Boxes, limit: float) -> str:
        """What of the arm is nearer than `limit` metres to boxes, or around one of them.

        '' where nothing is.
        """
        places = [self._shapes.oMg[i] for i in self._moving]
        at = [T.act(self.things[i].center) for i, T in zip(self._moving, places, strict=True)]
        near = boxes.within(np.array(at), self._radii[self._moving] + limit)
        for i, T, rows in zip(self._moving, places, near, strict=True):
            if not len(rows):
                continue
            thing, middles = self.things[i], (boxes.middle[rows] - T.translation) @ T.rotation
            away = np.abs(middles - thing.center) - thing.half
            some = (away <= (boxes.radius[rows] + limit)[:, None]).all(axis=1)
            place = coal.Transform3s(T.rotation, T.translation)
            for row in rows[some][np.argsort(away[some].max(axis=1))].tolist():
                box = coal.Box(2.0 * np.maximum(boxes.half[row], 1e-9))
                there = coal.Transform3s(_UPRIGHT, boxes.middle[row])
                if _are_nearer(thing.shape, place, box, there, limit):
                    return f"{thing.link} is nearer than {limit:.6f} m to box {row}"
            if some.any() and thing.encloses_any(middles[some]):
                return f"{thing.link} is around a box"
        return ""

    def near_itself(self, limit: float) -> str:
        """Which links are nearer than `limit` metres to each other, or one in the other.

        With a limit of 0, those that meet. '' where none is.
        """
        at = np.array([T.act(t.center) for T, t in zip(self._shapes.oMg, self.things, strict=True)])
        both = np.array(self._pairs, dtype=np.int64).reshape(-1, 2)
        between = np.linalg.norm(at[both[:, 0]] - at[both[:, 1]], axis=1)
        for i, j in both[between <= self._radii[both].sum(axis=1) + limit].tolist():
            one, other = self.things[i], self.things[j]
            T_one, T_other = self._shapes.oMg[i], self._shapes.oMg[j]
            places = [coal.Transform3s(T.rotation, T.translation) for T in (T_one, T_other)]
            shapes = one.shape, places[0], other.shape, places[1]
            if limit > 0.0:
                near = _are_nearer(*shapes, limit)
            else:
                near = bool(coal.collide(*shapes, coal.CollisionRequest(), coal.CollisionResult()))
            if (
                near
                or _inside_of(one, T_one, other, T_other)
                or _inside_of(other, T_other, one, T_one)
            ):
                return f"{one.link} and {other.link}"
        return ""


def _inside_of(inner: LinkSolid, T_inner: pin.SE3, outer: LinkSolid, T_outer: pin.SE3) -> bool:
    """Whether a component of one, which meets nothing of the other, is inside of it."""
    if not outer.closed:
        return False
    points = inner.points @ T_inner.rotation.T + T_inner.translation
    return outer.encloses_any((points - T_outer.translation) @ T_outer.rotation)


def _are_nearer(
    a: coal.CollisionGeometry,
    T_a: coal.Transform3s,
    b: coal.CollisionGeometry,
    T_b: coal.Transform3s,
    limit: float,
) -> bool:
    """Whether the surfaces are nearer than `limit` metres; trees end where nothing can be."""
    result = coal.DistanceResult()
    result.min_distance = limit
    return bool(coal.distance(a, T_a, b, T_b, coal.DistanceRequest(), result) < limit)


def _link_solid(thing: pin.GeometryObject, model: pin.Model, arm: set[int]) -> LinkSolid:
    shape = thing.geometry
    shape.computeLocalAABB()
    box = shape.aabb_local
    low, high = np.array(box.min_), np.array(box.max_)
    parts: tuple[Component, ...] = ()
    if isinstance(shape, coal.BVHModelBase):
        rows = [shape.tri_indices(k) for k in range(shape.num_tris)]
        triangles = np.array([[row[0], row[1], row[2]] for row in rows], dtype=np.int64)
        parts = components(np.array(shape.vertices()), triangles)
    above = frozenset(arm & set(model.supports[thing.parentJoint].tolist()))
    link = str(model.frames[thing.parentFrame].name)
    return LinkSolid(link, above, shape, parts, (low + high) / 2.0, (high - low) / 2.0)


def _with_one_coordinate_each(urdf: str) -> tuple[str, dict[str, tuple[str, float, float]]]:
    """The text with continuous joints as revolute ones, and which joints mimic which, how."""
    root = ET.fromstring(urdf)
    mimics = {}
    for joint in root.findall("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            for limit in joint.findall("limit"):
                joint.remove(limit)
            ET.SubElement(joint, "limit", lower="-1e9", upper="1e9", velocity="1", effort="1")
        mimic = joint.find("mimic")
        if mimic is not None:
            factor, offset = (float(mimic.get(*each)) for each in _MIMIC)
            mimics[str(joint.get("name"))] = str(mimic.get("joint")), factor, offset
            joint.remove(mimic)
    return ET.tostring(root, encoding="unicode"), mimics


_UPRIGHT = np.eye(3)
_MIMIC = (("multiplier", "1"), ("offset", "0"))
