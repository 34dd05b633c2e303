"""Gaps in surfaces carry nothing: gratings, wires and perforated plates, against their solids."""

import numpy as np
import pytest
from helpers.gratings import (
    HALF,
    Z,
    along_wires,
    at,
    bars,
    outline,
    perforated,
    rods,
    sampled,
    solid,
    support_of,
    wires,
)

TOLERANCE = 0.003


@pytest.mark.parametrize("cell", [0.01, 0.02])
@pytest.mark.parametrize(
    ("width", "gap", "spacing"),
    [(0.003, 0.008, 0.0012), (0.005, 0.01, 0.002), (0.005, 0.015, 0.0015), (0.01, 0.02, 0.004)],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_bars_carry_and_the_gaps_between_them_do_not(width, gap, spacing, seed, cell):
    """However they run through cells and points, with and without a floor below.

    Where the bars themselves end, gaps are open, and are told by the hull of points alone.
    """
    rng = np.random.default_rng(seed)
    for angle in (0.0, rng.uniform(0.0, np.pi)):
        inside = bars(width, gap, angle, rng.uniform(0.0, 0.01))
        points = at(sampled(inside, spacing, rng, angle + seed * rng.uniform(0.0, np.pi)))
        if seed:
            points = np.vstack([points, at(sampled(solid, spacing, rng), Z - 0.1)])
        _, support = support_of(points, cell)
        probes = rng.uniform(-HALF, HALF, (8000, 2))
        stands = support.supported(at(probes), TOLERANCE)
        depth, well = inside(probes), outline(probes) > 0.02
        assert depth[stands & well].min() > -0.5e-3  # half a pixel
        assert stands[well & (depth > 0.6 * spacing)].mean() > 0.7


@pytest.mark.parametrize(
    ("inside", "spacing", "hole"),
    [
        (wires(0.003, 0.012, 0.3), 0.0012, 0.012),
        (wires(0.005, 0.025, 1.1), 0.002, 0.025),
        (perforated(0.008, 0.012, 0.4), 0.0015, 0.008),
        (perforated(0.02, 0.03, 0.2), 0.0025, 0.02),
    ],
)
def test_holes_are_gaps_up_to_their_rounded_corners(inside, spacing, hole):
    rng = np.random.default_rng(3)
    _, support = support_of(at(sampled(inside, spacing, rng, 0.9)))
    probes = rng.uniform(-HALF, HALF, (20000, 2))
    stands = support.supported(at(probes), TOLERANCE)
    depth = inside(probes)
    well = outline(probes) > 0.02
    assert depth[stands].min() > -0.3 * hole
    # Holes count as wider than they are, so that their corners are open, too.
    assert stands[well & (depth > 0.6 * spacing)].mean() > 0.2
    assert not stands[depth < -0.4 * hole].any()


@pytest.mark.parametrize("cell", [0.01, 0.02])
@pytest.mark.parametrize(
    ("width", "gap", "spacing"),
    [(0.003, 0.0125, 0.005), (0.003, 0.015, 0.005), (0.002, 0.008, 0.003), (0.004, 0.03, 0.006)],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_holes_of_meshes_that_are_two_and_a_half_spacings_wide(width, gap, spacing, seed, cell):
    """All that holds for each point of a wire holds for one of a table with points so sparse."""
    rng = np.random.default_rng(seed)
    xy, inside = along_wires(width, gap, spacing, rng, seed * rng.uniform(0.0, np.pi))
    _, support = support_of(at(xy), cell)
    probes = rng.uniform(-HALF, HALF, (8000, 2))
    probes = probes[outline(probes) > 0.02]
    stands = support.supported(at(probes), TOLERANCE)
    depth = inside(probes)
    assert stands[depth < -0.0015].mean() < 0.05
    assert not stands[depth < -0.4 * gap].any()


@pytest.mark.parametrize("cell", [0.01, 0.02])
@pytest.mark.parametrize(
    ("diameter", "pitch", "spacing"), [(0.004, 0.015, 0.003), (0.005, 0.02, 0.005)]
)
@pytest.mark.parametrize("seed", [0, 1])
def test_gaps_of_rods_that_show_a_row_of_points_each(diameter, pitch, spacing, seed, cell):
    """From above like a table of which a line scanner saw rows; but that has no flanks."""
    rng = np.random.default_rng(seed)
    points, inside = rods(diameter, pitch, spacing, rng, seed * rng.uniform(0.0, np.pi))
    points = np.vstack([points, at(sampled(solid, 0.004, rng), Z - 0.06)])
    _, support = support_of(points, cell)
    probes = rng.uniform(-HALF, HALF, (8000, 2))
    probes = probes[outline(probes) > 0.025]
    stands = support.supported(at(probes), TOLERANCE)
    assert stands[inside(probes) < -0.0015].mean() < 0.1


@pytest.mark.parametrize("noise", [0.0, 0.001])
@pytest.mark.parametrize(
    ("diameter", "pitch", "spacing"),
    [(0.003, 0.015, 0.004), (0.005, 0.025, 0.005), (0.006, 0.04, 0.002)],
)
def test_of_two_rows_of_crossed_rods_nothing_but_rods_carries(diameter, pitch, spacing, noise):
    """As of an oven rack: a row lies across beneath the other."""
    rng = np.random.default_rng(5)
    upper, along = rods(diameter, pitch, spacing, rng, 0.4)
    lower, across = rods(diameter, 1.5 * pitch, spacing, rng, 0.4 + 0.5 * np.pi)
    points = np.vstack([upper, lower - [0.0, 0.0, diameter]])
    points += rng.normal(0.0, noise, points.shape)
    regions, support = support_of(points)
    probes = rng.uniform(-HALF, HALF, (20000, 2))
    depth = np.maximum(along(probes), across(probes))
    for z in (Z, Z - diameter, *(region.z for region in regions)):
        assert not support.supported(at(probes, z), TOLERANCE)[depth < -0.0015 - noise].any()
        assert not support.supported(at(probes, z), TOLERANCE, 0.003).any()


@pytest.mark.parametrize("spacing", [0.0025, 0.005])
def test_all_of_the_top_of_a_can_carries(spacing):
    """Its wall is below the points at its rim, on one side."""
    rng = np.random.default_rng(11)
    inner = at(sampled(lambda xy: 0.042 - np.hypot(*xy.T), spacing, rng))
    turns = np.arange(0.0, 2.0 * np.pi, spacing / 0.0425)
    rim = 0.0425 * np.column_stack([np.cos(turns), np.sin(turns)])
    wall = np.vstack([at(rim, z) for z in np.arange(Z, Z - 0.06, -spacing)])
    _, support = support_of(np.vstack([inner, wall]))
    probes = rng.uniform(-0.03, 0.03, (4000, 2))
    probes = probes[np.hypot(*probes.T) < 0.036]
    assert support.supported(at(probes), TOLERANCE).all()


@pytest.mark.parametrize("cell", [0.01, 0.02])
def test_rows_without_flanks_and_sheets_with_an_underside_are_solid(cell):
    rng = np.random.default_rng(10)
    rows = at(sampled(solid, 0.0018, rng, 0.4, "rows", 4.0))
    top, bottom = (at(sampled(solid, 0.004, rng, rng.uniform(0.0, 1.0)), z) for z in (Z, Z - 0.004))
    probes = rng.uniform(-0.07, 0.07, (5000, 2))
    scattered = [at(sampled(solid, 0.002, rng, kind="random"), z) for z in (Z, Z - 0.004)]
    for points in (rows, np.vstack([top, bottom]), np.vstack(scattered)):
        _, support = support_of(points, cell)
        assert support.supported(at(probes), TOLERANCE).mean() > 0.98


@pytest.mark.parametrize("cell", [0.01, 0.02])
@pytest.mark.parametrize("kind", ["lattice", "lattice with gaps", "random", "rows", "noise"])
def test_solid_surfaces_stay_solid_however_they_are_sampled(kind, cell):
    rng = np.random.default_rng(4)
    for spacing in (0.001, 0.002):
        along = 4.0 if kind == "rows" else 1.0
        xy = sampled(solid, spacing / np.sqrt(along), rng, 0.4, kind, along)
        points = at(xy)
        if kind == "lattice with gaps":
            points = points[rng.random(len(points)) < 0.8]
        if kind == "noise":
            points = points + rng.normal(0.0, 0.003, points.shape)
        _, support = support_of(points, cell)
        probes = rng.uniform(-0.07, 0.07, (5000, 2))
        stands = support.supported(at(probes), TOLERANCE)
        assert stands.mean() > 0.98
