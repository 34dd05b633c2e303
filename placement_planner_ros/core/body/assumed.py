"""What the planner takes an object for, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from placement_planner_ros.core.body.placement_face import PlacementFace
from placement_planner_ros.core.types import Array


def in_words(
    points: Array,
    scale: float,
    center: Array,
    *,
    whose: str,
    fault: str,
    pieces: int,
    parts: int,
    faces: Sequence[PlacementFace],
    left_out: int,
    excess: float,
) -> tuple[str, ...]:
    """Size and scale, centre of mass, whether it is closed, what stands for it, and its rests.

    Args:
        points: (n, 3) metres.
        scale: metres per unit of the mesh.
        center: (3,) of mass.
        whose: what that is taken from.
        fault: why the mesh has no inside; empty where it has.
        pieces: connected pieces of the mesh.
        parts: convex parts that hold it.
        faces: that it may be placed on.
        left_out: faces that it may not as it could roll.
        excess: metres that convex parts reach beyond the mesh.
    """
    size = " x ".join(f"{side:.4g}" for side in np.ptp(points, axis=0))
    unit = "its numbers taken as metres" if scale == 1.0 else f"object.scale {scale:g}"
    where = ", ".join(f"{x:.4f}" for x in np.round(center, 4) + 0.0)
    whole = fault or "closed"
    rolling = sum(face.rolls for face in faces)
    rests = _count(len(faces), "rest")
    if rolling:
        rests += f", from {rolling} of which it could roll"
    if left_out:
        rests += f", and {left_out} from which it could roll left out (object.allow_rolling)"
    cover = f"{_count(pieces, 'piece')} in {_count(parts, 'convex part')}"
    if excess:
        cover += f" that {'reaches' if parts == 1 else 'reach'} up to {excess:.2g} m beyond it"
    return (
        f"{size} m, {unit}",
        f"centre of mass ({where}) {whose}",
        f"{whole}, {cover}",
        rests,
    )


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
