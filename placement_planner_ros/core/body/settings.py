"""How a mesh becomes a body: the numbers."""

from __future__ import annotations

from dataclasses import dataclass

from placement_planner_ros.core.settings import Settings, setting


@dataclass(frozen=True, slots=True)
class BodySettings(Settings):
    """How a mesh becomes a body.

    Attributes:
        merge_angle: hull facets within this angle of a placement face are not faces of their own.
        flatness: vertices within this of a face's plane belong to v(f); keep it below the
            contact tolerance.
        contact_flatness: ... and within this they bear the object, for the two limits below;
            at most a hundredth of the height of the centre of mass, so that round sides do not
            pass for flat ones.
        center_margin: how far inside a face the projected centre of mass must lie; at most
            a quarter of the object's smallest extent.
        tipping_angle: the least tilt about an edge of the face that makes the object fall over
            must be larger; twice that where the next facet of the hull is so close in
            direction (`rolling_angle`) that the object would roll on.
        max_face_vertices: v(f) is thinned to so many, extreme in evenly spread directions.
        voxel_size: spacing of B_o.
        max_volume_points: B_o is made coarser above that.
        max_extent: larger objects are taken for ones in millimetres.
    """

    merge_angle: float = setting(0.18, "(0, inf)", "rad")
    flatness: float = setting(0.001, "(0, inf)", "m")
    contact_flatness: float = setting(0.0003, "(0, inf)", "m")
    center_margin: float = setting(0.01, "[0, inf)", "m")
    tipping_angle: float = setting(0.15, "[0, inf)", "rad")
    rolling_angle: float = setting(0.5, "[0, inf)", "rad")
    max_face_vertices: int = setting(16, "[4, inf)")
    voxel_size: float = setting(0.005, "(0, inf)", "m")
    max_volume_points: int = setting(20_000, "[1, inf)")
    max_extent: float = setting(2.0, "(0, inf)", "m")
