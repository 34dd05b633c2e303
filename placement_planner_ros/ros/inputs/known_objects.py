"""Things that are known without a cloud: as `~/known_objects` tells of them, or placed by a run."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import trimesh
from visualization_msgs.msg import Marker, MarkerArray

from placement_planner_ros.core.body.mesh import require_few
from placement_planner_ros.core.errors import ParameterError, PlacementPlannerError, forget_where
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.wishes.checks import check_pose_value
from placement_planner_ros.ros.inputs.known_surface import KnownSurface, PlacedBody
from placement_planner_ros.ros.inputs.mesh_process import MeshProcess, mesh_of_file
from placement_planner_ros.ros.inputs.point_cloud import FAR_M
from placement_planner_ros.ros.inputs.reading import Reading
from placement_planner_ros.ros.inputs.resources import Files
from placement_planner_ros.ros.parameters.checks import poses_from_list

TOPIC = "~/known_objects"
ROUND_M = 0.0002
"""By which the facets of what is round lie within it at most."""

Name = tuple[str, int]
"""Namespace and id."""
PoseOf = Callable[[str], pin.SE3]
"""T_planning_frame now. Raises a PlacementPlannerError where nobody knows it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Thing:
    """One of them.

    Attributes:
        corners: (t, 3, 3) triangles in its own frame, metres; none where a file has them.
        file: the key of that file; None without one.
        scale: of what the file holds.
        fault: what is wrong with it.
        placed: the same where it was last asked for, and where that was.
    """

    frame: str
    T_frame_thing: pin.SE3
    corners: Array
    file: Hashable
    scale: Array
    fault: PlacementPlannerError | None = None
    placed: tuple[pin.SE3, KnownSurface] | None = None

    def same(self, other: _Thing) -> bool:
        """Whether both are the same thing at the same place."""
        return (
            self.fault is None
            and (self.frame, self.file) == (other.frame, other.file)
            and self.T_frame_thing == other.T_frame_thing
            and np.array_equal(self.scale, other.scale)
            and np.array_equal(self.corners, other.corners)
        )


class KnownObjects:
    """Things by namespace and id, and bodies that were placed. Safe to use from several threads.

    Args:
        files: finds mesh files.

    Attributes:
        changes: how often the things of `~/known_objects` became other ones.
        placed: what was placed by the number of its run, in that order; replaced as a whole.
    """

    def __init__(self, files: Files) -> None:
        self._files = files
        self._lock = threading.Lock()
        self._things: dict[Name, _Thing] = {}
        self.reading: Reading[Array] = Reading(TOPIC, ParameterError)
        self.changes = 0
        self.placed: dict[int, PlacedBody] = {}

    def __len__(self) -> int:
        return len(self._things)

    def take(self, message: MarkerArray) -> list[PlacementPlannerError]:
        """Add, replace and delete what the message says; what is wrong with any of it.

        What is wrong with a thing stays until it is replaced or deleted: it is somewhere.
        """
        faults: list[PlacementPlannerError] = []
        with self._lock:
            things = dict(self._things)
        # as RViz does: one after the other, on a copy
        for marker in message.markers:
            name = marker.ns, int(marker.id)
            if marker.action == Marker.DELETE:
                things.pop(name, None)
            elif marker.action == Marker.DELETEALL:
                things = {n: thing for n, thing in things.items() if marker.ns not in ("", n[0])}
            else:
                made = things[name] = self._thing(marker, f"{TOPIC}: {marker.ns}/{marker.id}")
                faults += [] if made.fault is None else [made.fault]
        with self._lock:
            before = self._things
            # what is the same stays the same object, and so do its points
            for name, thing in things.items():  # many tell the same again and again
                if name in before and thing.same(before[name]):
                    things[name] = before[name]
            self.changes += before != things
            self._things = things
        return faults

    def confirm(self, run: int, thing: PlacedBody) -> None:
        """What that run placed stands there now, and nowhere else."""
        with self._lock:
            others = {n: each for n, each in self.placed.items() if n != run}
            self.placed = {**others, run: thing}

    def remove(self, run: int) -> PlacedBody | None:
        """Forget what that run placed, and give it; None where nothing of it stands."""
        with self._lock:
            thing = self.placed.get(run)
            self.placed = {n: each for n, each in self.placed.items() if n != run}
        return thing

    def surfaces(self, pose_of: PoseOf) -> tuple[KnownSurface, ...]:
        """All in the planning frame; the same objects as long as they are the same.

        Raises:
            ParameterError: one is unusable.
            NotReadyError: one is being read.
            PlacementPlannerError: nobody knows where one's frame is.
        """
        with self._lock:
            things = dict(self._things)
        found = []
        for name, thing in things.items():
            T = pose_of(thing.frame) * thing.T_frame_thing
            # its frame may have moved since it was asked for last
            if thing.placed is None or not thing.placed[0].isApprox(T, 1e-9):
                corners = self._corners(thing)
                surface = KnownSurface(corners @ T.rotation.T + T.translation)
                with self._lock:
                    # unless it was replaced while its surface was being made
                    if self._things.get(name) is thing:
                        self._things[name] = replace(thing, placed=(T, surface))
            else:
                surface = thing.placed[1]
            found.append(surface)
        return (*found, *(each.surface for each in self.placed.values()))

    def _corners(self, thing: _Thing) -> Array:
        if thing.fault is not None:
            raise thing.fault.with_traceback(None)  # which would grow each time
        return thing.corners if thing.file is None else self.reading.get(thing.file) * thing.scale

    def _thing(self, marker: Marker, field: str) -> _Thing:
        """A marker as a thing; with what is wrong with it where it is none."""
        p, r, s = marker.pose.position, marker.pose.orientation, marker.scale
        pose, scale = [p.x, p.y, p.z, r.x, r.y, r.z, r.w], np.array([s.x, s.y, s.z])
        thing = _Thing(marker.header.frame_id, pin.SE3.Identity(), np.zeros((0, 3, 3)), None, scale)
        try:
            check_pose_value(f"{field}: pose", pose)
            thing = replace(thing, T_frame_thing=poses_from_list(field, pose)[0])
            if not ((scale > 0.0) & (scale <= FAR_M)).all():
                raise ParameterError(f"{field}: scale", scale.tolist(), "give metres above zero")
            if marker.type == Marker.MESH_RESOURCE:
                file = self._file(marker.mesh_resource, f"{field}: mesh_resource")
                return replace(thing, file=file)
            return replace(thing, corners=_triangles(marker, scale, field))
        except PlacementPlannerError as error:
            forget_where(error)
            # kept, as it is there: a start is refused until it is replaced or deleted
            return replace(thing, fault=error)

    def _file(self, uri: str, field: str) -> Hashable:
        """Begin to read a mesh file, its header found in order; by what it is kept."""
        try:
            # what the header shows is told at once, all else when the file is read
            key, read_mesh = mesh_of_file(self._files.find(uri, trusted=False))
        except (OSError, ValueError) as error:
            raise ParameterError(field, uri, f"cannot be read: {error}") from error

        def read() -> Array:
            try:
                with MeshProcess() as process:
                    vertices, triangles = read_mesh(process)
            except (OSError, ValueError) as error:
                raise ParameterError(field, uri, f"cannot be read: {error}") from error
            return vertices[triangles]

        self.reading.want(key, read, lasting=True)
        return key


def _triangles(marker: Marker, scale: Array, field: str) -> Array:
    """(t, 3, 3) triangles of a marker, metres."""
    if marker.type == Marker.CUBE:
        return np.asarray(trimesh.creation.box(scale).triangles)
    if marker.type == Marker.CYLINDER:
        sections = _sections(float(scale[:2].max()) / 2)
        # of diameter and height 1, then scaled, so that it may be elliptic
        tube = trimesh.creation.cylinder(0.5, 1.0, sections)
        return np.asarray(tube.triangles) * scale
    if marker.type == Marker.SPHERE:
        # each division halves the edges, of which there are five around a pole at first
        fine = int(np.ceil(np.log2(_sections(float(scale.max()) / 2) / 5)))
        ball = trimesh.creation.icosphere(min(max(fine, 3), 6), 0.5)
        return np.asarray(ball.triangles) * scale
    if marker.type == Marker.TRIANGLE_LIST:
        # before arrays of that size are made
        require_few(len(marker.points), len(marker.points) // 3)
        points = np.array([[p.x, p.y, p.z] for p in marker.points]) * scale
        if not len(points) or len(points) % 3 or not (np.abs(points) <= FAR_M).all():
            raise ParameterError(
                f"{field}: points", f"{len(points)} points", "give three for each triangle, m"
            )
        return points.reshape(-1, 3, 3)
    words = "give CUBE, SPHERE, CYLINDER, TRIANGLE_LIST or MESH_RESOURCE"
    raise ParameterError(f"{field}: type", marker.type, words)


def _sections(radius: float) -> int:
    """Facets around what is round, so that they lie within it by `ROUND_M` at most."""
    # a facet's middle lies radius * (1 - cos(pi / facets)) within the circle
    share = min(ROUND_M / radius, 1.0)
    return max(16, int(np.ceil(np.pi / np.arccos(1.0 - share))))
