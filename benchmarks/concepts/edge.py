"""What a certified edge is: distances at a few places, and a bound on motion between them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from scipy.spatial import cKDTree

from benchmarks.cases import Case, make_problem
from benchmarks.drawing.plots import new_figure
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.grasp.holding import Holding
from placement_planner_ros.core.planner import PlacementPlanner, PlannerSettings
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.types import Array

CASE = Case("table", "small_crayons_box", "maximize_clearance")
_SEED = 1
_DRAWN = 300
_SHORTEST = 1.0 / 1024
"""Share of an edge below which an interval is not halved."""


def draw_edge(path: Path) -> None:
    """Write a PNG: of a way that was found, the longest straight edge that is certified.

    For each interval, the distance of the held object at its middle and how far any of its points
    can move up to the ends: the drawn tent. Where that stays above the margin, so does the object.
    """
    problem, objective = make_problem(CASE, np.random.default_rng(_SEED))
    settings = PlannerSettings()
    planner = PlacementPlanner(problem, objective, settings, np.random.default_rng(_SEED))
    placement = next(planner.run(lambda: False))
    holding = planner.holdings[placement.goal.arm, placement.goal.grasp]
    moves = _Moves(
        holding.chain, holding.arm.grasps[holding.grasp].homogeneous, _points_inside(problem.body)
    )
    obstacles = problem.environment.obstacles
    nearest = cKDTree((obstacles.lower + obstacles.upper) / 2.0)
    until = placement.trajectory.times <= placement.approach_start
    a, b = _longest_edge(holding, placement.trajectory.positions[until])
    margin = settings.collision.collision_margin
    figure = new_figure(9.0, 4.2)
    _draw_on(figure.subplots(), moves, nearest, a, b, margin)
    figure.savefig(path)


def _longest_edge(holding: Holding, way: Array) -> tuple[Array, Array]:
    """Of the straight motions between points of a way (n, dof), the longest that is certified."""
    pairs = [(a, b) for i, a in enumerate(way) for b in way[i + 1 :] if holding.transit_free(a, b)]
    return max(pairs, key=lambda pair: float(np.abs(pair[1] - pair[0]).sum()))


def _points_inside(body: Body) -> Array:
    """Points (n, 3) of the object, close enough to tell its distances in a drawing."""
    return np.vstack([body.vertices, body.volume_points])


class _Moves:
    """The held object along a motion of the arm, by points of it.

    Args:
        T_tip_object: (4, 4).
        points: (n, 3) in the object's frame.
    """

    def __init__(self, chain: Chain, T_tip_object: Array, points: Array) -> None:
        self._chain = chain
        self._in_tip = points @ T_tip_object[:3, :3].T + T_tip_object[:3, 3]

    def points(self, q: Array) -> Array:
        """(n, 3) in the world."""
        T = self._chain.forward(q)
        return np.asarray(self._in_tip @ T[:3, :3].T + T[:3, 3])

    def bound(self, q: Array, delta: Array) -> float:
        """How far any point can move while each joint moves by at most delta (dof,) from q."""
        points, moved = self.points(q), 0.0
        for k in reversed(range(self._chain.dof)):
            T = self._chain.joint_frames(q)[k]
            away = points - T[:3, 3]
            across = np.linalg.norm(away - np.outer(away @ T[:3, 2], T[:3, 2]), axis=1).max()
            moved += delta[k] * (1.0 if self._chain.prismatic[k] else float(across) + moved)
        return moved


def _draw_on(
    axes: Axes, moves: _Moves, nearest: cKDTree, a: Array, b: Array, margin: float
) -> None:
    def distance(at: float) -> float:
        return float(nearest.query(moves.points(a + at * (b - a)))[0].min())

    shares = np.linspace(0.0, 1.0, _DRAWN)
    axes.plot(shares, [distance(at) for at in shares], color="black", lw=1.8, label="distance")
    axes.axhline(margin, color="#c02020", label=f"margin, {1e3 * margin:.0f} mm")
    waiting, label = [(0.5, 0.5)], "certified interval: distance at its middle less the bound"
    while waiting:
        middle, half = waiting.pop()
        bound = moves.bound(a + middle * (b - a), half * np.abs(b - a))
        peak = distance(middle)
        if peak - bound < margin and half > _SHORTEST:
            waiting += [(middle - half / 2, half / 2), (middle + half / 2, half / 2)]
            continue
        ends = [middle - half, middle, middle + half]
        axes.fill_between(
            ends, margin, [peak - bound, peak, peak - bound], alpha=0.35, color="#2060b0",
            lw=0.8, label=label,
        )  # fmt: skip
        axes.plot([middle], [peak], "o", color="#2060b0", markersize=3)
        label = ""
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0)
    axes.set_xlabel("share of the edge")
    axes.set_ylabel("m from the held object to the nearest thing")
    axes.legend(frameon=False, fontsize=8)
    axes.set_title("A certified edge: few places are looked at, all of it is known to be free")
