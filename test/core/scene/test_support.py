"""s(x) at the ends of surfaces, against the true outlines of plates turned at random."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from placement_planner_ros.core.scene.environment import Environment, find_regions
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.scenes import scene_by_name

BOUNDS = (np.array([-0.35, -0.35, -0.1]), np.array([0.35, 0.35, 0.3]))
VOLUME = TargetVolume(*BOUNDS)
TOLERANCE = 0.003
HALF_A_PIXEL = 0.00125


def support_of(points, cell=0.01, bounds=BOUNDS, sights=()):
    obstacles = ObstacleSet.from_points(points, GridSettings(cell_size=cell), bounds)
    return find_regions(obstacles, VOLUME, sights=sights)[1]


def inward(hull, xy):
    """(n,) m, how far inside of a convex outline points (n, 2) lie; negative outside."""
    return -(xy @ hull.equations[:, :2].T + hull.equations[:, 2]).max(axis=1)


def lattice(rng, spacing, half=0.3):
    """(n, 2) a square lattice of random phase."""
    line = np.arange(-half, half, spacing) + rng.uniform(0.0, spacing)
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)


def turned(xy, angle):
    c, s = np.cos(angle), np.sin(angle)
    return xy @ np.array([[c, s], [-s, c]])


def plate(rng):
    """A random bar or plate, its corners (k, 2), turned and shifted at random."""
    if rng.random() < 0.5:
        half = np.array([rng.uniform(0.08, 0.2), rng.uniform(0.02, 0.12)])
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    else:
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 7))
        corners = 0.18 * np.column_stack([np.cos(angles), np.sin(angles)])
    return turned(corners, rng.uniform(0.0, np.pi)) + rng.uniform(-0.02, 0.02, 2)


def on_plane(xy, z):
    return np.column_stack([xy, np.full(len(xy), z)])


@pytest.mark.parametrize("seed", range(4))
def test_nothing_stands_beyond_a_convex_edge_and_all_stands_well_inside(seed):
    """However the edge runs through the cells, with and without a floor below."""
    rng = np.random.default_rng(seed)
    near_edge = 0
    for trial in range(12):
        cell = rng.choice([0.005, 0.01, 0.02])
        spacing = min(cell * rng.uniform(0.2, 0.5), 0.005)  # wider holes carry by rays alone
        corners = plate(rng)
        hull = ConvexHull(corners)
        xy = turned(lattice(rng, spacing), rng.uniform(0.0, np.pi))
        points = on_plane(xy[inward(hull, xy) >= 0.0], 0.1 + rng.uniform(0.0, 0.01))
        z = points[0, 2]
        if trial % 2:
            points = np.vstack([points, on_plane(xy, z - 0.05)])
        support = support_of(points, cell)
        probes = corners[rng.integers(len(corners), size=4000)]
        probes = probes + rng.uniform(-0.5, 1.0, (4000, 1)) * (
            corners[rng.integers(len(corners), size=4000)] - probes
        )
        probes = np.vstack([probes + rng.normal(0.0, cell, (4000, 2)), xy])
        depth = inward(hull, probes)
        for margin in (0.0, 0.003, 0.015, 0.05):
            stands = support.supported(on_plane(probes, z), TOLERANCE, margin)
            assert (depth[stands] >= margin - HALF_A_PIXEL).all()
            assert stands[depth > margin + 2.0 * cell].all()
            near_edge += (stands & (depth < margin + cell)).sum()
    assert near_edge > 5000


def test_a_corner_cut_out_is_closed_by_less_than_the_widest_disc_that_is_no_gap():
    """Of the stated bound: for 90° by (sqrt 2 - 1) times its radius, of a spacing of a lattice."""
    rng = np.random.default_rng(5)
    worst = 0.0
    for _ in range(12):
        spacing = rng.uniform(0.002, 0.005)
        angle = rng.uniform(0.0, np.pi)
        xy = turned(lattice(rng, spacing), rng.uniform(0.0, np.pi))
        corner = rng.uniform(-0.05, 0.05, 2)
        out = turned(xy - corner, angle)
        support = support_of(on_plane(xy[(out < 0.0).any(axis=1)], 0.1))
        probes = corner + rng.uniform(-0.02, 0.02, (4000, 2))
        beyond = turned(probes - corner, angle).min(axis=1)
        for margin in (0.0, 0.003):
            stands = support.supported(on_plane(probes, 0.1), TOLERANCE, margin)
            worst = max(worst, beyond[stands].max() / spacing)
            assert (beyond[stands] <= 0.8 * spacing).all()
    assert worst > 0.05


def test_the_margin_is_kept_from_drops_and_from_the_unseen_but_not_from_things():
    """A table with an edge, a wall, a low rim, a box, and a strip that was not seen."""
    step = 0.0025
    line = np.arange(-0.25, 0.25 + 1e-9, step)
    xy = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    unseen = (np.abs(xy[:, 1]) < 0.02) & (xy[:, 0] > -0.1) & (xy[:, 0] < 0.1)
    box = (np.abs(xy - [-0.14, 0.14]) < 0.03).all(axis=1)
    table = on_plane(xy[~unseen & ~box], 0.0)
    up = np.arange(0.0, 0.1, step)
    wall = np.array([(0.25, y, z) for y in line for z in up])  # at x = 0.25
    rim = np.array([(x, 0.25, z) for x in line for z in up[up <= 0.015]])  # at y = 0.25
    sides = np.arange(-0.03, 0.03 + 1e-9, step)
    block = [(s, e, z) for s in sides for e in (-0.03, 0.03) for z in up]
    block += [(e, s, z) for s, e, z in block]
    block = np.add(block, (-0.14, 0.14, 0.0))
    support = support_of(np.vstack([table, wall, rim, block]))
    probes = np.random.default_rng(0).uniform(-0.247, 0.247, (6000, 2))
    probes = probes[~((np.abs(probes - [-0.14, 0.14]) < 0.035).all(axis=1))]
    hole = np.maximum(np.abs(probes) - [0.1, 0.02], 0.0)
    drop = np.minimum((probes + 0.25).min(axis=1), np.linalg.norm(hole, axis=1))
    assert support.supported(on_plane(probes[drop > 0.01], 0.0), TOLERANCE).all()
    for margin in (0.003, 0.008, 0.03, 0.1):
        stands = support.supported(on_plane(probes, 0.0), TOLERANCE, margin)
        assert (drop[stands] > margin - 0.7 * step).all()
        assert stands[drop > margin + 0.012].all()
        # up to the wall, the rim and the box
        beside = np.minimum(0.25 - probes.max(axis=1), np.abs(probes - [-0.14, 0.14]).max(axis=1))
        assert (stands & (drop > margin + 0.012) & (beside < 0.045)).sum() > 20


@pytest.mark.parametrize(
    ("name", "deck", "edges"),
    [
        ("table", "table", "x -x y -y"),
        ("cabinet_low_clutter", "drawers", "-x"),
        ("cabinet_high_clutter", "drawers", "-x"),
    ],
)
def test_of_what_is_8_cm_from_edges_and_1_cm_from_things_nearly_all_keeps_a_margin_of_8_cm(
    name, deck, edges
):
    """A cabinet's walls, its thin divider and what stands in it are things, not edges."""
    scene = scene_by_name(name)
    support = Environment.from_points(complete_cloud(scene), scene.volume).support
    (plate,) = (part.vertices for part in scene.parts if part.name == deck)
    low, high, z = plate.min(axis=0)[:2], plate.max(axis=0)[:2], plate[:, 2].max()
    probes = np.random.default_rng(0).uniform(low, high, (8000, 2))
    away = {"-x": probes[:, 0] - low[0], "x": high[0] - probes[:, 0]}
    away |= {"-y": probes[:, 1] - low[1], "y": high[1] - probes[:, 1]}
    kept = np.all([away[edge] >= 0.08 for edge in edges.split()], axis=0)
    for part in scene.parts:
        if part.name != deck and part.vertices[:, 2].min() < z + 0.02:
            kept &= inward(ConvexHull(part.vertices[:, :2]), probes) < -0.01
    kept &= (probes >= scene.volume.lower[:2]).all(1) & (probes <= scene.volume.upper[:2]).all(1)
    stands = support.supported(on_plane(probes, z), TOLERANCE, 0.08)
    assert kept.sum() > 1000
    assert stands[kept].mean() > 0.97


def test_edges_of_noisy_surfaces_are_moved_in():
    rng = np.random.default_rng(4)
    hull = ConvexHull(plate(rng))
    xy = turned(lattice(rng, 0.003), 0.7)
    points = on_plane(xy[inward(hull, xy) >= 0.0], 0.1)
    noisy = points + rng.normal(0.0, 0.002, points.shape)
    floor = np.tile([1.5, 0.0, -1.0], (12, 1))
    support = support_of(noisy, sights=[View(np.vstack([noisy, floor]), np.array([0.1, 0.1, 1.0]))])
    probes = np.vstack([xy, xy + 0.001])
    stands = support.supported(on_plane(probes, 0.1), TOLERANCE, 0.003)
    depth = inward(hull, probes)
    assert depth[stands].min() > 0.0
    assert stands[depth > 0.003 + 0.02].mean() > 0.99
