"""Clearance C over the true solids."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from .carried import clipped
from .insides import piece_voxels
from .pieces import Piece
from .stance import standing_along
from .task import Array, Task, Tolerances, world_vertices


class Clearance:
    """C(x) of one object among true solids."""

    def __init__(self, task: Task, components: Sequence[Piece], tolerances: Tolerances) -> None:
        self._task = task
        self._tolerances = tolerances
        self._samples = piece_voxels(components)
        self._prisms: dict[bytes, list[tuple[float, list[tuple[Array, float, float]]]]] = {}

    def mean(self, T_world_object: Array) -> float:
        """C: mean distance of the object's voxel centres sideways and upwards, metres."""
        return float(self._distances(T_world_object, 0.0).mean())

    def bounds(self, T_world_object: Array) -> tuple[float, float]:
        """Least and greatest C where heights are known to a layer of cells only.

        What ends within a layer above a point may count as beside or as below it: distances
        sideways and upwards jump there, whatever the cells' size.
        """
        exact = self._distances(T_world_object, 0.0)
        raised = self._distances(T_world_object, self._tolerances.layer)
        return float(np.minimum(exact, raised).mean()), float(np.maximum(exact, raised).mean())

    def _distances(self, T_world_object: Array, raised: float) -> Array:
        """(n,) sideways and upwards of the voxel centres, raised by as much, metres.

        Sideways is along the surface that the object stands on: heights are those above a plane of
        its slope, of V through its middle.
        """
        task = self._task
        normal = standing_along(task, T_world_object, self._tolerances)
        shear = np.eye(3)
        shear[2, :2] = normal[:2] / normal[2]
        points = (self._samples @ T_world_object[:3, :3].T + T_world_object[:3, 3]) @ shear.T
        points[:, 2] += raised
        lowest = (world_vertices(task, T_world_object) @ shear.T)[:, 2].min()
        volume = np.array(task.volume)
        middle = 0.5 * (volume[:, 0].min(axis=0) + volume[:, 1].max(axis=0))
        volume[:, :, 2] += float(shear[2, :2] @ middle[:2])
        best = np.full(len(points), 0.5)
        for top, prisms in self._sheared(shear):
            if top <= lowest + self._tolerances.contact:
                continue
            for outline, low, high in prisms:
                for lower, upper in volume:
                    ends = lower - task.beyond, upper + task.beyond
                    _lower_distance(best, points, outline, low, high, *ends)
        return best

    def _sheared(self, shear: Array) -> list[tuple[float, list[tuple[Array, float, float]]]]:
        """Top and prisms of each solid, sheared; made once for each slope."""
        key = shear.tobytes()
        if key not in self._prisms:
            solids = [np.asarray(solid.vertices) @ shear.T for solid in self._task.solids]
            self._prisms[key] = [(float(v[:, 2].max()), upright_prisms(v)) for v in solids]
        return self._prisms[key]


def upright_prisms(vertices: Array, thickness: float = 0.002) -> list[tuple[Array, float, float]]:
    """A convex solid as upright prisms: outline (k, 2) counter-clockwise, bottom, top.

    Exact where it is one; else slices, each as wide as its wider end.
    """
    z = vertices[:, 2]
    low, high = float(z.min()), float(z.max())
    bottom, top = vertices[z < low + 1e-9], vertices[z > high - 1e-9]
    if len(bottom) + len(top) == len(vertices) and len(bottom) == len(top) >= 3:
        outlines = [c[ConvexHull(c[:, :2]).vertices, :2] for c in (bottom, top)]
        if all(np.linalg.norm(outlines[1] - p, axis=1).min() < 1e-9 for p in outlines[0]):
            return [(outlines[0], low, high)]
    levels = np.linspace(low, high, int(np.ceil((high - low) / thickness)) + 1)
    a, b = (index.ravel() for index in np.meshgrid(*[np.arange(len(vertices))] * 2))
    rising = z[b] - z[a] > 1e-12
    a, b = a[rising], b[rising]
    cuts = []
    for level in levels:
        crossing = (z[a] <= level) & (z[b] >= level)
        p, r = vertices[a[crossing]], vertices[b[crossing]]
        share = ((level - p[:, 2]) / (r[:, 2] - p[:, 2]))[:, None]
        cuts.append((p + share * (r - p))[:, :2])
    result = []
    for i in range(len(levels) - 1):
        both = np.vstack([cuts[i], cuts[i + 1]])
        result.append((both[ConvexHull(both).vertices], float(levels[i]), float(levels[i + 1])))
    return result


def _lower_distance(
    best: Array,
    points: Array,
    outline: Array,
    low: float,
    high: float,
    volume_lower: Array,
    volume_upper: Array,
) -> None:
    """Lower `best` (n,) to the distance sideways and upwards to a prism's part in V."""
    low, high = max(low, volume_lower[2]), min(high, volume_upper[2])
    (x0, y0), (x1, y1) = volume_lower[:2], volume_upper[:2]
    outline = clipped(outline, np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]))
    if low >= high or len(outline) < 3:
        return
    rise = np.maximum(low - points[:, 2], 0.0)
    box = np.maximum(outline.min(axis=0) - points[:, :2], points[:, :2] - outline.max(axis=0))
    rows = np.flatnonzero(
        (points[:, 2] <= high) & (np.hypot(np.hypot(*np.maximum(box, 0).T), rise) < best)
    )
    xy = points[rows, :2]
    edges = np.roll(outline, -1, axis=0) - outline
    relative = xy[:, None] - outline
    inside = (edges[:, 0] * relative[..., 1] - edges[:, 1] * relative[..., 0] >= 0).all(axis=1)
    length = np.maximum((edges**2).sum(axis=1), 1e-18)
    along = np.clip((relative * edges).sum(axis=2) / length, 0, 1)
    sideways = np.linalg.norm(relative - along[..., None] * edges, axis=2).min(axis=1)
    distance = np.hypot(np.where(inside, 0.0, sideways), rise[rows])
    best[rows] = np.minimum(best[rows], distance)
