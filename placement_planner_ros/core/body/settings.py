"""The numbers by which a mesh becomes a body."""

from __future__ import annotations

from dataclasses import dataclass

from placement_planner_ros.core.settings import Settings, setting


@dataclass(frozen=True, slots=True)
class BodySettings(Settings):
    """How a mesh becomes a body.

    Attributes:
        merge_angle: of rests within this angle of each other the lowest stands for all.
        flatness: see its words; vertices within it of a rest's plane belong to v(f).
        allow_rolling: see its words.
        max_face_vertices: v(f) is thinned to so many, extreme in evenly spread directions.
        voxel_size: spacing of B_o.
        max_volume_points: B_o is made coarser above that.
        max_extent: larger objects are taken for ones in millimetres.
    """

    merge_angle: float = setting(0.18, "(0, inf)", "rad")
    flatness: float = setting(
        0.0015,
        "[0.0001, 0.02]",
        "m",
        "How far a supporting patch of the object may be from flat: noise of a scan, or a bulge.",
    )
    allow_rolling: bool = setting(
        False, text="Whether the object may be placed where it could roll, too."
    )
    max_face_vertices: int = setting(16, "[4, inf)")
    voxel_size: float = setting(0.005, "(0, inf)", "m")
    max_volume_points: int = setting(20_000, "[1, inf)")
    max_extent: float = setting(2.0, "(0, inf)", "m")
