"""The grasped object, from a topic or from parameters; the latest given wins."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from shape_msgs.msg import Mesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.errors import ObjectError, PlacementPlannerError
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.resources import load_mesh
from placement_planner_ros.ros.parameters.values import ParameterSet

Source = Literal["none", "topic", "mesh", "vertices"]
_SOURCE_OF: dict[str, Source] = {
    "object.mesh": "mesh",
    "object.vertices": "vertices",
    "object.triangles": "vertices",
}


class NoObjectError(PlacementPlannerError):
    """Nobody said what the robot holds."""

    code = "NO_OBJECT"


@dataclass(frozen=True, slots=True, eq=False)
class _Mesh:
    vertices: Array
    triangles: npt.NDArray[np.int64]


class ObjectInput:
    """Makes the body from whatever was given last. Safe to use from several threads."""

    def __init__(self, parameters: ParameterSet) -> None:
        self._lock = threading.Lock()
        self._topic: _Mesh | None = None
        self._source: Source = _given(parameters, ("object.vertices", "object.mesh"), "none")
        self._bodies: dict[tuple[object, ...], Body] = {}

    @property
    def mesh(self) -> object:
        """The topic's newest mesh."""
        with self._lock:
            return self._topic

    def set_mesh(self, vertices: Array, triangles: npt.NDArray[np.int64]) -> None:
        """The topic's newest mesh, (n, 3) and (t, 3); from now on it is the object."""
        with self._lock:
            self._topic = _Mesh(vertices, triangles)
            self._source = "topic"

    def parameters_changed(self, names: Iterable[str], parameters: ParameterSet) -> None:
        """Parameters were set; where they describe an object, it is the object from now on."""
        with self._lock:
            fallback: Source = "none" if self._topic is None else "topic"
            if self._source in ("mesh", "vertices"):
                fallback = self._source
            changed = [name for name in names if name in _SOURCE_OF]
            if changed:
                self._source = _given(parameters, changed, fallback)

    def body(self, parameters: ParameterSet, overridden: Iterable[str] = ()) -> Body:
        """The object, with the centre of mass and scale of the parameters.

        Args:
            overridden: names of parameters that hold for this call only.

        Raises:
            NoObjectError: none was given.
            ObjectError: it is unusable.
        """
        with self._lock:
            mine = [name for name in overridden if name in _SOURCE_OF]
            source = _given(parameters, mine, self._source)
            topic = self._topic
        if source in ("mesh", "vertices"):
            source = _given(parameters, [f"object.{source}"], "none")
        center, scale = parameters["object.center_of_mass"], parameters["object.scale"]
        key: tuple[object, ...]
        if source == "topic" and topic is not None:
            key = ("topic", topic)
        elif source == "mesh":
            key = ("mesh", parameters["object.mesh"])
        elif source == "vertices":
            key = (
                "vertices",
                tuple(parameters["object.vertices"]),
                tuple(parameters["object.triangles"]),
            )
        else:
            raise NoObjectError(
                "object", "not given", "publish ~/object, or set object.mesh or object.vertices"
            )
        key = (*key, tuple(center), scale)
        with self._lock:
            known = self._bodies.get(key)
        if known is not None:
            return known
        vertices, triangles = _mesh(source, topic, parameters)
        body = Body.from_mesh(
            vertices,
            triangles,
            center_of_mass=np.array(center) if center else None,
            scale=scale,
        )
        with self._lock:
            self._bodies = {key: body}
        return body


def mesh_from_message(message: Mesh) -> tuple[Array, npt.NDArray[np.int64]]:
    """Vertices (n, 3) and triangles (t, 3) of a message."""
    vertices = np.array([[p.x, p.y, p.z] for p in message.vertices], dtype=np.float64)
    triangles = np.array([t.vertex_indices for t in message.triangles], dtype=np.int64)
    return vertices.reshape(-1, 3), triangles.reshape(-1, 3)


def _given(parameters: ParameterSet, names: Iterable[str], otherwise: Source) -> Source:
    """The source that the last non-empty one of these parameters belongs to."""
    source = otherwise
    for name in names:
        if parameters[name]:
            source = _SOURCE_OF[name]
    return source


def _mesh(
    source: Source, topic: _Mesh | None, parameters: ParameterSet
) -> tuple[Array, npt.NDArray[np.int64]]:
    if source == "topic" and topic is not None:
        return topic.vertices, topic.triangles
    if source == "mesh":
        return load_mesh(parameters["object.mesh"])
    vertices, triangles = parameters["object.vertices"], parameters["object.triangles"]
    for name, values in (("object.vertices", vertices), ("object.triangles", triangles)):
        if not values or len(values) % 3 != 0:
            raise ObjectError(name, f"{len(values)} numbers", "give three for each, at least one")
    faces = np.array(triangles, dtype=np.int64).reshape(-1, 3)
    if np.max(faces) >= len(vertices) // 3:
        raise ObjectError(
            "object.triangles", int(np.max(faces)), f"there are only {len(vertices) // 3} vertices"
        )
    return np.array(vertices, dtype=np.float64).reshape(-1, 3), faces
