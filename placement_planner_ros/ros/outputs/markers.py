"""RViz markers of a run: V, keep_out, regions, what was placed before, and the arm's path."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.ros.outputs.conversions import pose_message

_VOLUME = ColorRGBA(r=0.2, g=0.4, b=0.9, a=0.12)
_KEEP_OUT = ColorRGBA(r=0.9, g=0.1, b=0.1, a=0.25)
_REGION = ColorRGBA(r=0.2, g=0.7, b=0.3, a=0.6)
_OBJECT = ColorRGBA(r=0.9, g=0.5, b=0.1, a=0.9)
_PATH = ColorRGBA(r=0.8, g=0.1, b=0.5, a=1.0)
_STANDING = ColorRGBA(r=0.1, g=0.5, b=0.5, a=1.0)
_MOST_POINTS = 1500
"""Of an object that stands, as all of them go along with every placement."""
_ABOVE = 0.001
"""Metres by which regions are drawn above their surface."""


def no_markers() -> MarkerArray:
    """Deletes every marker."""
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL)])


def scene_markers(
    frame: str,
    stamp: Time,
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
    header = Header(frame_id=frame, stamp=stamp)
    return [
        *_boxes(header, "target_volume", volume.boxes, _VOLUME),
        *_boxes(header, "keep_out", keep_out, _KEEP_OUT),
        _triangles(header, "regions", _region_corners(regions), pin.SE3.Identity(), _REGION),
        *(
            Marker(
                header=header,
                ns="standing",
                id=number,
                type=Marker.POINTS,
                pose=pose_message(pin.SE3.Identity()),
                scale=Vector3(x=0.006, y=0.006, z=0.0),
                color=_STANDING,
                points=_points(points[:: -(-len(points) // _MOST_POINTS)]),
            )
            for number, points in enumerate(standing)
        ),
    ]


def placement_markers(
    frame: str, stamp: Time, body: Body, T_world_object: pin.SE3, path: Array
) -> list[Marker]:
    """A placement.

    Args:
        path: (n, 3) way of the tip.
    """
    header = Header(frame_id=frame, stamp=stamp)
    corners = body.vertices[body.triangles].reshape(-1, 3)
    return [
        _triangles(header, "object", corners, T_world_object, _OBJECT),
        Marker(
            header=header,
            ns="path",
            type=Marker.LINE_STRIP,
            pose=pose_message(pin.SE3.Identity()),
            scale=Vector3(x=0.005, y=0.0, z=0.0),
            color=_PATH,
            points=_points(path),
        ),
    ]


def _boxes(header: Header, ns: str, boxes: Array, color: ColorRGBA) -> list[Marker]:
    """One marker for each of (k, 2, 3) corners."""
    return [
        Marker(
            header=header,
            ns=ns,
            id=number,
            type=Marker.CUBE,
            pose=pose_message(pin.SE3(np.eye(3), (lower + upper) / 2)),
            scale=Vector3(**dict(zip("xyz", (upper - lower).tolist(), strict=True))),
            color=color,
        )
        for number, (lower, upper) in enumerate(boxes)
    ]


def _region_corners(regions: Iterable[Region]) -> Array:
    """Two triangles per rectangle, as (k, 3) corners."""
    corners: list[Array] = []
    for region in regions:
        for x0, y0, x1, y1 in region.rectangles:
            xy = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
            a, b, c, d = np.column_stack([xy, region.heights(xy) + _ABOVE])
            corners += [a, b, c, a, c, d]
    return np.array(corners, dtype=np.float64).reshape(-1, 3)


def _triangles(header: Header, ns: str, corners: Array, T: pin.SE3, color: ColorRGBA) -> Marker:
    return Marker(
        header=header,
        ns=ns,
        type=Marker.TRIANGLE_LIST,
        action=Marker.ADD if len(corners) else Marker.DELETE,
        pose=pose_message(T),
        scale=Vector3(x=1.0, y=1.0, z=1.0),
        color=color,
        points=_points(corners),
    )


def _points(points: Array) -> list[Point]:
    return [Point(x=x, y=y, z=z) for x, y, z in points.tolist()]
