"""Points on planes, in the bounds of a small scene."""

import numpy as np

BOUNDS = ((-0.5, -0.5, -0.2), (0.5, 0.5, 0.6))


def plane(lower, upper, spacing=0.003):
    """Grid of points on an axis-aligned rectangle, edges included."""
    axes = [
        np.linspace(a, b, max(1, round((b - a) / spacing)) + 1) if b > a else np.array([a])
        for a, b in zip(lower, upper, strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def floor_and_wall():
    floor = plane((-0.195, -0.195, 0.0127), (0.195, 0.2033, 0.0127))
    wall = plane((-0.195, 0.2033, 0.0127), (0.195, 0.2033, 0.3))
    return np.vstack([floor, wall])
