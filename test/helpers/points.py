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


def floor_can_shelf_wall():
    """A floor, a can, a shelf overhead and a wall."""
    angle = np.linspace(0.0, 2.0 * np.pi, 80, endpoint=False)
    can = [
        np.c_[0.1 + 0.034 * np.cos(angle), 0.05 + 0.034 * np.sin(angle), np.full(80, z)]
        for z in np.arange(0.0, 0.12, 0.003)
    ]
    return np.vstack(
        [
            plane((-0.35, -0.35, 0.0042), (0.35, 0.35, 0.0042)),
            plane((-0.2, -0.2, 0.2512), (0.0, 0.1, 0.2512)),
            plane((0.271, -0.3, 0.0), (0.271, 0.0, 0.45)),
            *can,
        ]
    )
