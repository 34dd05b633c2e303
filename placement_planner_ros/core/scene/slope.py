"""How fast d_S changes at most."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.scene.distance import ClearanceField


def greatest_slope(field: ClearanceField) -> float:
    """L with |d_S(p) - d_S(q)| ≤ L ‖p - q‖ for any two points of the same height.

    In a layer d_S is continuous and bilinear between grid lines, so its derivative by x is linear
    in y and that by y linear in x: within a square each is greatest on its edges. Outside the
    layer d_S is that of the nearest point of it.
    """
    steepest = 0.0
    for layer in field.values.reshape(-1, *field.values.shape[2:]):
        along_x = np.diff(layer, axis=0) ** 2
        along_y = np.diff(layer, axis=1) ** 2
        along_x = np.maximum(along_x[:, 1:], along_x[:, :-1])
        along_y = np.maximum(along_y[1:], along_y[:-1])
        steepest = max(steepest, float((along_x + along_y).max()))
    return float(np.sqrt(steepest)) / field.cell_size
