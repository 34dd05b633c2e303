"""Things that are known without a cloud, as `~/known_objects` tells of them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import trimesh
from visualization_msgs.msg import Marker, MarkerArray

from placement_planner_ros.core.body.mesh import require_few
from placement_planner_ros.core.errors import PlacementPlannerError, forget_where
from placement_planner_ros.core.meshes.headers import check_header
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.known_surface import KnownSurface
from placement_planner_ros.ros.inputs.mesh_process import MeshProcess
from placement_planner_ros.ros.inputs.reading import Reading
from placement_planner_ros.ros.inputs.resources import Files

TOPIC = "~/known_objects"
MOST = 1000
"""Things that may be known at a time."""
_ROUND = 0.0002
"""m by which the facets of what is round lie within it at most."""
_FINEST = 6
"""Times that the triangles of a ball are divided by four at most."""
_FAR = 1e4
"""m from its frame within which a thing lies."""

Name = tuple[str, int]
"""Namespace and id."""
PoseOf = Callable[[str], pin.SE3]
"""T_planning_frame now. Raises a PlacementPlannerError where nobody knows it."""


class KnownObjectError(PlacementPlannerError):
    """A thing of `~/known_objects` is unusable."""

    code = "BAD_PARAMETER"


@dataclass(frozen=True, slots=True, eq=False)
class _Thing:
    """One of them.

    Attributes:
        corners: (t, 3, 3) triangles in its own frame, metres; the key of a file that is read; or
            what is wrong with it.
        scale: of what the file holds.
        placed: the same where it was last asked for, and where that was.
    """

    frame: str
    T_frame_thing: pin.SE3
    corners: Array | Hashable | PlacementPlannerError
    scale: Array
    placed: tuple[pin.SE3, KnownSurface] | None = None


class KnownObjects:
    """Things by namespace and id. Safe to use from several threads.

    Args:
        files: finds mesh files.

    Attributes:
        changes: how often they became other ones.
    """

    def __init__(self, files: Files) -> None:
        self._files = files
        self._lock = threading.Lock()
        self._things: dict[Name, _Thing] = {}
        self.reading: Reading[Array] = Reading(TOPIC, _explain)
        self.changes = 0

    def __len__(self) -> int:
        return len(self._things)

    def take(self, message: MarkerArray) -> list[PlacementPlannerError]:
        """Add, replace and delete what the message says; what is wrong with any of it.

        What is wrong with a thing stays until it is replaced or deleted: it is somewhere.
        """
        faults = []
        for marker in message.markers:
            name = marker.ns, int(marker.id)
            thing: _Thing | None = None
            if marker.action == Marker.ADD:
                thing = self._thing(marker, f"{TOPIC}: {marker.ns}/{marker.id}")
                if isinstance(thing.corners, PlacementPlannerError):
                    faults.append(thing.corners)
            with self._lock:
                if thing is not None and (name in self._things or len(self._things) < MOST):
                    self._things[name] = thing
                elif thing is not None:
                    faults.append(KnownObjectError(TOPIC, f"{MOST} things", "delete some"))
                elif marker.action == Marker.DELETE:
                    self._things.pop(name, None)
                elif marker.action == Marker.DELETEALL:
                    self._things = {
                        n: t for n, t in self._things.items() if marker.ns not in ("", n[0])
                    }
                self.changes += 1
        return faults

    def surfaces(self, pose_of: PoseOf) -> tuple[KnownSurface, ...]:
        """All of them in the planning frame; the same objects as long as they are the same.

        Raises:
            KnownObjectError: one is unusable.
            NotReadyError: one is being read.
            PlacementPlannerError: nobody knows where one's frame is.
        """
        with self._lock:
            things = dict(self._things)
        found = []
        for name, thing in things.items():
            T = pose_of(thing.frame) * thing.T_frame_thing
            if thing.placed is None or not thing.placed[0].isApprox(T, 1e-9):
                corners = self._corners(thing)
                surface = KnownSurface(corners @ T.rotation.T + T.translation)
                with self._lock:
                    if self._things.get(name) is thing:
                        self._things[name] = replace(thing, placed=(T, surface))
            else:
                surface = thing.placed[1]
            found.append(surface)
        return tuple(found)

    def _corners(self, thing: _Thing) -> Array:
        corners = thing.corners
        if isinstance(corners, PlacementPlannerError):
            raise corners.with_traceback(None)  # which would grow each time
        return (
            corners if isinstance(corners, np.ndarray) else self.reading.get(corners) * thing.scale
        )

    def _thing(self, marker: Marker, field: str) -> _Thing:
        """A marker as a thing; with what is wrong with it where it is none."""
        p, r, s = marker.pose.position, marker.pose.orientation, marker.scale
        numbers = np.array([p.x, p.y, p.z, r.x, r.y, r.z, r.w])
        T, scale = pin.SE3.Identity(), np.array([s.x, s.y, s.z])
        corners: Array | Hashable | PlacementPlannerError
        try:
            if not abs(np.linalg.norm(numbers[3:]) - 1.0) < 1e-2:
                raise KnownObjectError(
                    f"{field}: orientation", numbers[3:].tolist(), "give length 1"
                )
            if not (np.abs(numbers[:3]) <= _FAR).all():
                raise KnownObjectError(f"{field}: position", numbers[:3].tolist(), "give metres")
            rotation = pin.Quaternion(numbers[3:] / np.linalg.norm(numbers[3:]))
            T = pin.SE3(rotation.toRotationMatrix(), numbers[:3])
            if not ((scale > 0.0) & (scale <= _FAR)).all():
                raise KnownObjectError(f"{field}: scale", scale.tolist(), "give metres above zero")
            corners = self._shape(marker, scale, field)
        except PlacementPlannerError as error:
            forget_where(error)
            corners = error
        return _Thing(marker.header.frame_id, T, corners, scale)

    def _shape(self, marker: Marker, scale: Array, field: str) -> Array | Hashable:
        """(t, 3, 3) triangles of a marker, or the key of the file that holds them."""
        if marker.type == Marker.CUBE:
            return np.asarray(trimesh.creation.box(scale).triangles)
        if marker.type == Marker.CYLINDER:
            sections = _sections(float(scale[:2].max()) / 2)
            tube = trimesh.creation.cylinder(0.5, 1.0, sections)
            return np.asarray(tube.triangles) * scale
        if marker.type == Marker.SPHERE:
            # each division halves the edges, of which there are five around a pole at first
            fine = int(np.ceil(np.log2(_sections(float(scale.max()) / 2) / 5)))
            ball = trimesh.creation.icosphere(min(max(fine, 3), _FINEST), 0.5)
            return np.asarray(ball.triangles) * scale
        if marker.type == Marker.TRIANGLE_LIST:
            require_few(len(marker.points), len(marker.points) // 3)
            points = np.array([[p.x, p.y, p.z] for p in marker.points]) * scale
            if not len(points) or len(points) % 3 or not (np.abs(points) <= _FAR).all():
                raise KnownObjectError(
                    f"{field}: points", f"{len(points)} points", "give three for each triangle, m"
                )
            return points.reshape(-1, 3, 3)
        if marker.type == Marker.MESH_RESOURCE:
            return self._file(marker.mesh_resource, f"{field}: mesh_resource")
        raise KnownObjectError(
            f"{field}: type",
            marker.type,
            "give CUBE, SPHERE, CYLINDER, TRIANGLE_LIST or MESH_RESOURCE",
        )

    def _file(self, uri: str, field: str) -> Hashable:
        """Begin to read a mesh file, its header found in order; by what it is kept."""
        try:
            path = self._files.find(uri, trusted=False)
            check_header(path)
            found = path.stat()
        except (OSError, ValueError) as error:
            raise KnownObjectError(field, uri, f"cannot be read: {error}") from error

        def read(should_stop: Callable[[], bool]) -> Array:
            try:
                with MeshProcess(should_stop) as process:
                    vertices, triangles = process.read(path)
            except (OSError, ValueError) as error:
                raise KnownObjectError(field, uri, f"cannot be read: {error}") from error
            return vertices[triangles]

        key = path, found.st_size, found.st_mtime_ns
        self.reading.want(key, read, lasting=True)
        return key


def _sections(radius: float) -> int:
    """Facets around what is round, so that they lie within it by `_ROUND` at most."""
    share = min(_ROUND / radius, 1.0)
    return max(16, int(np.ceil(np.pi / np.arccos(1.0 - share))))


def _explain(error: Exception) -> PlacementPlannerError:
    return KnownObjectError(TOPIC, type(error).__name__, f"cannot be read: {error}")
