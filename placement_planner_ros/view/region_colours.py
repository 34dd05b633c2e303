"""Colours of the regions by the objective, where the page can estimate it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.types import Array
from placement_planner_ros.view import colours
from placement_planner_ros.view.itself import Itself
from placement_planner_ros.view.objective_map import (
    CAP,
    ObstacleLayers,
    estimated_clearance,
    inner_points,
    sign_that_agrees,
)
from placement_planner_ros.view.poses import pose_of
from placement_planner_ros.view.record import Improvement
from placement_planner_ros.view.world import Surface, World

_KNOWN = {"maximize_clearance": 1, "minimize_clearance": -1}


class RegionColours:
    """Estimates the clearance objective over the regions.

    Attributes:
        ends: the least and the greatest ξ of the newest estimate; None where there is none.
    """

    def __init__(self) -> None:
        self.ends: tuple[float, float] | None = None
        self._inner: tuple[Array, Array] = (np.zeros((0, 3)), np.zeros((0, 3)))
        self._layers: tuple[object, ObstacleLayers] | None = None

    def of(
        self,
        pieces: Array,
        best: Improvement | None,
        surface: Surface | None,
        obstacles: Array,
        volume: Array,
        world: World,
    ) -> npt.NDArray[np.uint8] | None:
        """(n, 3) colours of the pieces (n, 4, 3), the object being turned as in the best placement.

        None where another objective is sought, or what is estimated of the best placement is not
        what the node says of it.
        """
        self.ends = None
        if best is None or surface is None or best.solution.terms:
            return None
        if len(pieces) == 0 or len(volume) == 0:
            return None
        if world.parameter("objective", "") not in _KNOWN:
            return None
        T = pose_of(best.solution.pose.pose)
        if self._inner[0] is not surface[0]:
            self._inner = surface[0], inner_points(surface[0])
        points = self._inner[1]
        beyond = CAP if world.parameter("clearance.beyond_volume", True) else 0.0
        size = float(world.parameter("cloud.cell_size", 0.01))
        key = (Itself(obstacles), volume.tobytes(), size, beyond)
        if self._layers is None or self._layers[0] != key:
            self._layers = key, ObstacleLayers.of(obstacles, size, volume, beyond)
        places = np.vstack([pieces.mean(axis=1), _foot(surface[0], points, T)])
        values = estimated_clearance(places, T, points, self._layers[1])
        sign = sign_that_agrees(float(values[-1]), best.solution.objective)
        if sign == 0:
            return None
        values = sign * values[:-1]
        low, high = float(values.min()), float(values.max())
        self.ends = low, high
        return colours.scale((values - low) / max(high - low, 1e-6))


def _foot(vertices: Array, points: Array, T: pin.SE3) -> Array:
    """(1, 3) below the middle of the object at T, where it stands."""
    placed = vertices @ T.rotation.T + T.translation
    inside = points @ T.rotation.T + T.translation
    return np.array([[*inside[:, :2].mean(axis=0), placed[:, 2].min()]])
