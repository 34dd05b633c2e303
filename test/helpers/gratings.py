"""Surfaces with gaps, as functions that say how deep inside of the solid points of a plane lie."""

from __future__ import annotations

import numpy as np

from placement_planner_ros.core.scene.environment import find_regions
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.core.types import TargetVolume

HALF = 0.1
"""m, half of the edge of the surfaces."""
Z = 0.1037
BOUNDS = (np.array([-0.2, -0.2, -0.1]), np.array([0.2, 0.2, 0.3]))
VOLUME = TargetVolume(*BOUNDS)


def turned(xy, angle):
    c, s = np.cos(angle), np.sin(angle)
    return xy @ np.array([[c, -s], [s, c]])


def _bars(x, width, pitch):
    """(n,) m inside of the bar nearest to x; negative in a gap."""
    return 0.5 * width - np.abs((x + 0.5 * pitch) % pitch - 0.5 * pitch)


def bars(width, gap, angle=0.0, shift=0.0):
    """Parallel bars."""
    return lambda xy: _bars(turned(xy, angle)[:, 0] + shift, width, width + gap)


def wires(width, gap, angle=0.0, shift=0.0):
    """Bars in both directions."""

    def inside(xy):
        uv = turned(xy, angle) + shift
        return np.maximum(_bars(uv[:, 0], width, width + gap), _bars(uv[:, 1], width, width + gap))

    return inside


def perforated(diameter, pitch, angle=0.0, shift=0.0):
    """Round holes in a plate."""

    def inside(xy):
        uv = (turned(xy, angle) + shift + 0.5 * pitch) % pitch - 0.5 * pitch
        return np.hypot(uv[:, 0], uv[:, 1]) - 0.5 * diameter

    return inside


def solid(xy):
    return np.full(len(xy), 1.0)


def outline(xy):
    """(n,) m inside of the square that all surfaces end at."""
    return HALF - np.abs(xy).max(axis=1)


def sampled(inside, spacing, rng, angle=0.0, kind="lattice", along=1.0):
    """(n, 2) points of the solid, as far apart as that, in rows `along` times as far apart."""
    if kind == "random":
        xy = rng.uniform(-1.5 * HALF, 1.5 * HALF, (int((3.0 * HALF / spacing) ** 2), 2))
    else:
        x = np.arange(-1.5 * HALF, 1.5 * HALF, spacing) + rng.uniform(0.0, spacing)
        y = np.arange(-1.5 * HALF, 1.5 * HALF, along * spacing) + rng.uniform(0.0, spacing)
        xy = turned(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), angle)
    return xy[(inside(xy) >= 0.0) & (outline(xy) >= 0.0)]


def along_wires(width, gap, spacing, rng, angle=0.0):
    """(n, 2) points of `wires` that show two rows on each, so far apart; and how deep inside."""
    pitch = width + gap
    steps = np.arange(-2.0 * HALF, 2.0 * HALF, spacing)
    rows = [
        np.column_stack([steps + rng.uniform(0.0, spacing), np.full(len(steps), middle + side)])
        for middle in pitch * np.arange(-20, 21)
        for side in (-0.5 * width, 0.5 * width)
        for _ in range(2)
    ]
    rows[::2] = [row[:, ::-1] for row in rows[::2]]
    xy = turned(np.vstack(rows), -angle)
    return xy[outline(xy) >= 0.0], wires(width, gap, angle)


def rods(diameter, pitch, spacing, rng, angle=0.0):
    """(n, 3) points all over parallel rods, so far apart; how deep inside, from above."""
    turns = np.arange(count := max(3, round(np.pi * diameter / spacing))) * 2.0 * np.pi / count
    found = []
    for middle in pitch * np.arange(-20, 21):
        steps = np.arange(-2.0 * HALF, 2.0 * HALF, spacing) + rng.uniform(0.0, spacing)
        along, turn = (each.ravel() for each in np.meshgrid(steps, turns + 0.5 * np.pi))
        across = middle + 0.5 * diameter * np.cos(turn)
        found.append(np.column_stack([across, along, 0.5 * diameter * (np.sin(turn) - 1.0)]))
    points = np.vstack(found)
    points[:, :2] = turned(points[:, :2], -angle)
    points[:, 2] += Z
    return points[outline(points[:, :2]) >= 0.0], bars(diameter, pitch - diameter, angle)


def at(xy, z=Z):
    return np.column_stack([xy, np.full(len(xy), z)])


def support_of(points, cell=0.01):
    """Regions and support of points (n, 3)."""
    obstacles = ObstacleSet.from_points(points, GridSettings(cell_size=cell), BOUNDS)
    return find_regions(obstacles, VOLUME)
