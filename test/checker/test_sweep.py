"""What the checker leaves out of its sweeps changes nothing of what it finds."""

import coal
import numpy as np
import pytest
from helpers.right_solution import CHECKER, GOOD, Q_START, TASK, TOLERANCES

from checker import World
from checker.margin import too_near
from checker.poses import Poses

LIMIT = np.minimum(np.abs(CHECKER.robot.model.upperPositionLimit), 2.0)


@pytest.fixture(scope="module")
def swung() -> tuple[World, np.ndarray]:
    """States of both arms that go far into the table, and 2 mm boxes in the way."""
    rng = np.random.default_rng(5)
    ends = CHECKER.robot.configuration(Q_START) + rng.uniform(-0.9, 0.9, (6, len(LIMIT))) * LIMIT
    steps = np.linspace(0, 5, 120)
    states = np.column_stack([np.interp(steps, range(6), column) for column in ends.T])
    CHECKER.robot.fill_mimics(states)
    low = rng.uniform((0.1, -0.4, 0.0), (0.6, 0.4, 0.5), (300, 3))
    measured = np.stack([low, low + 0.002])
    task = type(TASK)(**{**TASK.__dict__, "measured": measured})
    return World.build(CHECKER.robot, task, CHECKER.components, GOOD, 0.003), states


def test_sweeps_find_what_looking_at_every_state_finds(swung) -> None:
    world, states = swung
    poses, times = Poses(world.robot.model, world.geometry, states), np.arange(len(states)) / 10
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    first = {}
    for i, j in world.pairs:
        things = [world.geometry.geometryObjects[k].geometry for k in (i, j)]
        for row in range(len(states)):
            placed = things[0], poses.at(i, row), things[1], poses.at(j, row)
            gap = coal.distance(*placed, request, coal.DistanceResult())
            if gap < -TOLERANCES.penetration:
                names = world._name(i), world._name(j)
                first[names] = min(first.get(names, np.inf), times[row])
                break
    found = world.sweep(states, times, np.inf, set(), TOLERANCES)
    told = [line for line in found if line.startswith("collision")]
    assert len(first) >= 8
    assert sorted(line.split(" s,")[0] for line in told) == sorted(
        f"collision: {a} with {b} at {time:.3f}" for (a, b), time in first.items()
    )


def test_margins_are_those_of_looking_at_every_box(swung) -> None:
    world, states = swung
    assert world.measured is not None
    poses, times = Poses(world.robot.model, world.geometry, states), np.arange(len(states)) / 10
    low, high = world.measured
    solids = [
        (coal.Box(b - a), coal.Transform3s(np.eye(3), (a + b) / 2))
        for a, b in zip(*world.measured, strict=True)
    ]
    worst: dict[str, float] = {}
    for i in world.moving:
        thing, link = world.geometry.geometryObjects[i].geometry, world.links[i]
        for row in range(len(states)):
            close = np.linalg.norm((low + high) / 2 - poses.middles[row, i], axis=1)
            for k in np.flatnonzero(close < poses.radii[i] + 0.01):
                gap = coal.distance(
                    thing,
                    poses.at(i, row),
                    *solids[k],
                    coal.DistanceRequest(),
                    coal.DistanceResult(),
                )
                worst[link] = min(worst.get(link, np.inf), gap)
    margin = TOLERANCES.margin - TOLERANCES.penetration
    near = {link: gap for link, gap in worst.items() if gap < margin}
    found = too_near(world, poses, times, np.inf, TOLERANCES)
    assert len(near) >= 3
    assert sorted(line.split(" mm")[0] for line in found) == sorted(
        f"margin: {link} is {1000 * gap:.2f}" for link, gap in near.items()
    )
