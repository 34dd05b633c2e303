"""How a mesh becomes a body: the numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from placement_planner_ros.core.errors import ParameterError


@dataclass(frozen=True, slots=True)
class BodySettings:
    """How a mesh becomes a body.

    Attributes:
        merge_angle: hull facets within this angle of a placement face are not faces of their own,
            rad.
        flatness: vertices within this of a face's plane belong to v(f), metres; keep it below the
            contact tolerance.
        contact_flatness: ... and within this they bear the object, for the two limits below;
            at most a hundredth of the height of the centre of mass, so that round sides do not
            pass for flat ones, metres.
        center_margin: how far inside a face the projected centre of mass must lie, metres; at most
            a quarter of the object's smallest extent.
        tipping_angle: the least tilt about an edge of the face that makes the object fall over
            must be larger, rad; twice that where the next facet of the hull is so close in
            direction (`rolling_angle`) that the object would roll on.
        rolling_angle: rad.
        max_face_vertices: v(f) is thinned to so many, extreme in evenly spread directions.
        voxel_size: spacing of B_o, metres.
        max_volume_points: B_o is made coarser above that.
        max_extent: larger objects are taken for ones in millimetres, metres.
    """

    merge_angle: float = 0.18
    flatness: float = 0.001
    contact_flatness: float = 0.0003
    center_margin: float = 0.01
    tipping_angle: float = 0.15
    rolling_angle: float = 0.5
    max_face_vertices: int = 16
    voxel_size: float = 0.005
    max_volume_points: int = 20_000
    max_extent: float = 2.0

    def __post_init__(self) -> None:
        for name in ("merge_angle", "flatness", "contact_flatness", "voxel_size", "max_extent"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ParameterError(name, value, "give a finite number above 0")
        for name in ("center_margin", "tipping_angle", "rolling_angle"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ParameterError(name, value, "give a finite number of at least 0")
        if self.max_face_vertices < 4:
            raise ParameterError("max_face_vertices", self.max_face_vertices, "give at least 4")
        if self.max_volume_points < 1:
            raise ParameterError("max_volume_points", self.max_volume_points, "give at least 1")
