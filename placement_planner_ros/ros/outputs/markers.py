"""RViz markers of a run: V, keep_out, regions, what was placed before, and the arm's path."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.contacts.friction_cones import CONE_SIDES
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.types import Array, Resting, TargetVolume
from placement_planner_ros.ros.inputs.point_cloud import some_of
from placement_planner_ros.ros.outputs.conversions import pose_message

_VOLUME = ColorRGBA(r=0.2, g=0.4, b=0.9, a=0.12)
_KEEP_OUT = ColorRGBA(r=0.9, g=0.1, b=0.1, a=0.25)
_REGION = ColorRGBA(r=0.2, g=0.7, b=0.3, a=0.6)
_OBJECT = ColorRGBA(r=0.9, g=0.5, b=0.1, a=0.9)
_PATH = ColorRGBA(r=0.8, g=0.1, b=0.5, a=1.0)
_STANDING = ColorRGBA(r=0.1, g=0.5, b=0.5, a=1.0)
_FORCE = ColorRGBA(r=0.1, g=0.2, b=0.8, a=1.0)
_WALL = ColorRGBA(r=0.5, g=0.3, b=0.7, a=0.35)
FORCE_LENGTH_M = 0.05
"""m, of the lines from where a leaning object touches, along what holds it, and of their cones."""


def scene_markers(
    header: Header,
    volume: TargetVolume,
    keep_out: Array,
    regions: Iterable[Region],
    standing: Iterable[Array],
) -> list[Marker]:
    """What stays the same over a run: V, what is kept out of, R, and what was placed before.

    Args:
        keep_out: (k, 2, 3) corners of boxes.
        standing: per object that was confirmed as placed, (n, 3) points on it.
    """
    few = map(some_of, standing)
    return [
        *_box_markers(header, "target_volume", volume.boxes, _VOLUME),
        *_box_markers(header, "keep_out", keep_out, _KEEP_OUT),
        _marker(header, "regions", Marker.TRIANGLE_LIST, _REGION, _region_corners(regions)),
        *(
            _numbered(_marker(header, "standing", Marker.POINTS, _STANDING, points, 0.006), number)
            for number, points in enumerate(few)
        ),
    ]


def placement_markers(
    header: Header, body: Body, T_world_object: pin.SE3, path: Array, resting: Resting | None
) -> list[Marker]:
    """A placement; where it leans, with what holds it where it touches.

    Args:
        path: (n, 3) way of the tip.
    """
    corners = body.vertices[body.triangles].reshape(-1, 3)
    placed = _marker(header, "object", Marker.TRIANGLE_LIST, _OBJECT, corners)
    placed.pose = pose_message(T_world_object)
    lines, wall = np.zeros((0, 3)), np.zeros((0, 3))
    if resting is not None and resting.on:
        lines, wall = _force_lines(resting), resting.wall[[0, 1, 2, 0, 2, 3]]
    return [
        placed,
        _marker(header, "contacts", Marker.LINE_LIST, _FORCE, lines, 0.002),
        _marker(header, "wall", Marker.TRIANGLE_LIST, _WALL, wall),
        _marker(header, "path", Marker.LINE_STRIP, _PATH, path, 0.005),
    ]


def _force_lines(resting: Resting) -> Array:
    """(2 m, 3) ends of lines from each contact along its normal, and of friction cones there."""
    turns = np.linspace(0.0, 2.0 * np.pi, CONE_SIDES + 1)
    lines = []
    for point, normal, friction in zip(
        resting.points, resting.normals, resting.friction, strict=True
    ):
        tip = point + FORCE_LENGTH_M * normal
        lines.append([point, tip])
        if friction > 0.0:
            # two directions across the normal, and the rim that they span
            across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
            across /= np.linalg.norm(across)
            sides = np.stack([across, np.cross(normal, across)])
            circle = np.column_stack([np.cos(turns), np.sin(turns)]) @ sides
            rim = tip + FORCE_LENGTH_M * friction * circle
            lines += [[point, corner] for corner in rim[1:]] + [
                list(side) for side in itertools.pairwise(rim)
            ]
    return np.array(lines).reshape(-1, 3)


def _box_markers(header: Header, ns: str, boxes: Array, color: ColorRGBA) -> list[Marker]:
    """One marker for each of (k, 2, 3) corners."""
    markers = []
    for number, (lower, upper) in enumerate(boxes):
        marker = _numbered(_marker(header, ns, Marker.CUBE, color), number)
        marker.pose = pose_message(pin.SE3(np.eye(3), (lower + upper) / 2))
        marker.scale = Vector3(**dict(zip("xyz", (upper - lower).tolist(), strict=True)))
        markers.append(marker)
    return markers


def _numbered(marker: Marker, number: int) -> Marker:
    """The same with that id."""
    marker.id = number
    return marker


def _region_corners(regions: Iterable[Region]) -> Array:
    """Two triangles per rectangle, as (k, 3) corners, 1 mm above the surface."""
    corners: list[Array] = []
    for region in regions:
        for x0, y0, x1, y1 in region.rectangles:
            xy = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
            a, b, c, d = np.column_stack([xy, region.heights(xy) + 0.001])
            corners += [a, b, c, a, c, d]
    return np.array(corners, dtype=np.float64).reshape(-1, 3)


def _marker(
    header: Header,
    ns: str,
    kind: int,
    color: ColorRGBA,
    points: Array | Sequence[Array] = (),
    scale: float = 1.0,
) -> Marker:
    """A marker where its frame is; without points it deletes what was there, but for a box.

    Args:
        scale: width of points and lines, metres.
    """
    # a placement that does not lean deletes the lines of the one before
    drawn = kind == Marker.CUBE or len(points) > 0
    return Marker(
        header=header,
        ns=ns,
        type=kind,
        action=Marker.ADD if drawn else Marker.DELETE,
        pose=pose_message(pin.SE3.Identity()),
        scale=Vector3(x=scale, y=scale, z=scale),
        color=color,
        points=[Point(x=float(x), y=float(y), z=float(z)) for x, y, z in points],
    )
