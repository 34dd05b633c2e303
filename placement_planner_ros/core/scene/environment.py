"""The surroundings as the planner knows them: obstacles, placement regions and support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.errors import VolumeError
from placement_planner_ros.core.scene.clearance import ClearanceField
from placement_planner_ros.core.scene.clearance_table import CAP
from placement_planner_ros.core.scene.cloud import AROUND_M, CONTACT_TOLERANCE_M, crop_cloud
from placement_planner_ros.core.scene.cloud_agreement import Disagreement
from placement_planner_ros.core.scene.compartment import has_unseen_ceiling
from placement_planner_ros.core.scene.freespace import OutsideRobot, SeenSpace, View
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.core.scene.keep_out import cut, kept_out
from placement_planner_ros.core.scene.layers import SlopeCloud
from placement_planner_ros.core.scene.near_points import NearPoints, laid_over
from placement_planner_ros.core.scene.planes import Plane, Planes
from placement_planner_ros.core.scene.regions import (
    Region,
    RegionSettings,
    largest_regions,
    regions_of_layers,
)
from placement_planner_ros.core.scene.support import SupportMap
from placement_planner_ros.core.scene.walls import Wall, find_walls
from placement_planner_ros.core.stopping import step
from placement_planner_ros.core.types import LEVEL, Array, Slope, TargetVolume


def require_room(volume: TargetVolume, cell_size: float) -> None:
    """Refuse a target volume of more cells than a computer has room for.

    Raises:
        VolumeError: it has more than `GridSettings.max_cells`, with what is known around it.
    """
    sides = volume.upper - volume.lower  # one grid holds all of its boxes
    padded = sides + 2.0 * AROUND_M * np.array([1.0, 1.0, 0.0])
    cells = float(np.prod(padded / cell_size + 2.0))
    most = GridSettings().max_cells
    if cells > most:
        raise VolumeError(
            "`volume`",
            " x ".join(f"{side:.4g}" for side in sides) + " m",
            f"has {cells:.3g} cells of {cell_size:g} m, the `cell_size`; it may have "
            f"{most:.3g}: give less, boxes nearer to each other or a larger `cell_size`",
        )


@dataclass(frozen=True, eq=False)
class Incline:
    """Surfaces that slope alike, in heights above a plane of that slope through the origin.

    Attributes:
        slope: of them.
        support: answers s(x).
        measured: the obstacle set.
        volume: V.
        beyond: m outside V in which things count for clearance.
    """

    slope: Slope
    support: SupportMap
    measured: ObstacleSet
    volume: TargetVolume
    beyond: float

    @cached_property
    def clearance(self) -> ClearanceField:
        """d_S in V for what stands on them: sideways is along the slope."""
        step("making distances to the environment")
        return ClearanceField(self.measured, self.volume, self.beyond, self.slope)

    def sheared(self, T_world_object: Array) -> Array:
        """(n, 4, 4) what takes points of the object to x, y and their height above the plane."""
        result = np.array(T_world_object)
        result[:, 2] -= np.einsum("i,nij->nj", np.array(self.slope), T_world_object[:, :2])
        return result


@dataclass(frozen=True, eq=False)
class Environment:
    """The preprocessed surroundings of one problem.

    Attributes:
        obstacles: the one obstacle set; where views are given, unknown space is part of it.
        regions: R, the placement regions in V, larger first.
        support: answers s(x), on every level surface, in V or not.
        inclines: the same of surfaces that slope.
        steep: planes in and around V that are steeper than `max_slope`, the largest first.
        max_slope: rad.
        keep_out: (k, 2, 3) corners of boxes that are obstacles without having been measured.
        measured: the obstacle set without unknown space: what regions, support and clearance are
            taken from.
        volume: V.
        points: how many finite points it was given, in the workspace or not.
        extent: (2, 3) lower and upper corner of these, NaN where there are none.
        beyond_volume: things up to the cap outside V count for the clearance, not only those in it.
        seen: share of V that the views saw, free or what was measured; None without views.
        seen_space: what sensors whose place is known saw in and around V; None without any.
        near: points beside the robot; the common ones are part of `obstacles`.
        disagreements: of the clouds it was made of.
        error: how far these may be off, metres.
    """

    obstacles: ObstacleSet
    regions: tuple[Region, ...]
    support: SupportMap
    measured: ObstacleSet
    volume: TargetVolume
    points: int = 0
    extent: Array = field(default_factory=lambda: np.full((2, 3), np.nan))
    beyond_volume: bool = True
    inclines: tuple[Incline, ...] = ()
    steep: tuple[Plane, ...] = ()
    max_slope: float = field(default_factory=lambda: RegionSettings().max_slope)
    keep_out: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    seen: float | None = None
    seen_space: SeenSpace | None = None
    near: NearPoints = field(default_factory=NearPoints)
    disagreements: tuple[Disagreement, ...] = ()
    error: float = 0.0
    _of_grasps: dict[bytes, tuple[ObstacleSet, ObstacleSet | None]] = field(
        default_factory=dict, init=False, repr=False
    )

    def with_near(self, near: NearPoints, error: float = 0.0) -> Environment:
        """The same with points beside the robot as obstacles, and of clouds that may be off.

        Raises:
            CloudError: they make the grid too large.
        """
        over = laid_over(self.obstacles, near.common)
        return self._changed(obstacles=over, near=near, error=error)

    def with_disagreements(self, found: Sequence[Disagreement]) -> Environment:
        """The same with nothing put down where clouds contradict each other."""
        points = np.vstack([np.zeros((0, 3)), *(each.points for each in found)])
        if not len(points):
            return self._changed(disagreements=tuple(found))
        cells = np.floor((points - self.obstacles.origin) / self.obstacles.cell_size)
        # what is cleaned of noise may come to lie a layer higher or lower
        around = np.unique(cells, axis=0)[:, None] + [(0, 0, -1), (0, 0, 0), (0, 0, 1)]
        without = self.obstacles.without_footing(around.reshape(-1, 3))
        return self._changed(disagreements=tuple(found), obstacles=without)

    def obstacles_of(self, arm: str, grasp: int) -> tuple[ObstacleSet, ObstacleSet | None]:
        """The obstacle set for an arm with the object in one of its grasps; and of that what `near`
        has for this grasp alone, which is no support either. None where that is nothing."""
        points = self.near.of_grasps.get((arm, grasp))
        if points is None or not len(points):
            return self.obstacles, None
        key = points.tobytes()
        if key not in self._of_grasps:
            size = GridSettings(cell_size=self.obstacles.cell_size)
            nothing = ObstacleSet.from_points(np.zeros((0, 3)), size, (points[0], points[0] + 1e-6))
            self._of_grasps[key] = laid_over(self.obstacles, points), laid_over(nothing, points)
        return self._of_grasps[key]

    def with_unknown(
        self, below_measured: bool = False, outside_robot: OutsideRobot | None = None
    ) -> Environment:
        """The same with what no sensor saw as obstacle, though never support; itself where no
        sensor's place is known.

        Args:
            below_measured: nothing above the highest that was measured is unknown.
            outside_robot: tells the cells that the robot is in, which are not unknown.

        Raises:
            CloudError: unknown space makes the grid too large.
        """
        space = self.seen_space
        if space is None:
            return self
        step("finding unknown space")
        obstacles = space.with_unknown(space.unknown(below_measured, outside_robot))
        return self._changed(obstacles=obstacles, seen=space.share_of_volume)

    def with_largest_region(self) -> Environment:
        """The same with only the largest region, and those level with it."""
        return self._changed(regions=level_with_largest(self.regions))

    def _changed(self, **changes: Any) -> Environment:
        """A copy in which what was made of what was measured holds as before."""
        made = replace(self, **changes)
        for name in ("clearance", "walls"):
            if name in self.__dict__:
                object.__setattr__(made, name, getattr(self, name))
        return made

    def keeping_out(self, boxes: Array, lower: Array, upper: Array) -> Environment:
        """The same with boxes (k, 2, 3) as obstacles, see `keep_out`.

        They are no support, and count neither as measured nor for the clearance.

        Args:
            lower, upper: (3,) corners of all space that anything gets to.

        Raises:
            CloudError: they make the grid too large.
        """
        if not len(boxes):
            return self
        step("keeping out of boxes")
        return self._changed(
            obstacles=kept_out(self.obstacles, boxes, lower, upper),
            regions=cut(self.regions, boxes),
            keep_out=boxes,
        )

    def support_of(self, slope: Slope) -> SupportMap:
        """What answers s(x) on surfaces of a slope that some region has."""
        if slope == LEVEL:
            return self.support
        return next(each.support for each in self.inclines if each.slope == slope)

    @property
    def has_unseen_ceiling(self) -> bool:
        """Whether V lies in a compartment whose ceiling no sensor saw."""
        return self.seen_space is not None and has_unseen_ceiling(self.seen_space, self.regions)

    @property
    def sparse(self) -> float:
        """Share of the largest surface that nothing is put down on as its points are so far apart
        that holes may lie between them, and no line of sight tells that there are none."""
        return self.support.sparse

    @cached_property
    def clearance(self) -> ClearanceField:
        """d_S in V, made when it is first asked for."""
        step("making distances to the environment")
        beyond = CAP if self.beyond_volume else 0.0
        return ClearanceField(self.measured, self.volume, beyond)

    @cached_property
    def walls(self) -> tuple[Wall, ...]:
        """Planes that stand in and around V, found when they are first asked for."""
        step("finding walls")
        space = self.seen_space
        return find_walls(self.measured, self.volume, () if space is None else space.views)

    @classmethod
    def from_points(
        cls,
        points: npt.ArrayLike,
        volume: TargetVolume,
        grid: GridSettings | None = None,
        regions: RegionSettings | None = None,
        bounds: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
        *,
        sights: Sequence[View] = (),
        beyond_volume: bool = True,
        noise: float | None = None,
    ) -> Environment:
        """Preprocess a cloud; what no sensor saw is free, unless `with_unknown` has it otherwise.

        Args:
            points: (n, 3) in the planning frame, metres; NaN where nothing was seen.
            volume: V.
            grid: GridSettings() unless given.
            regions: RegionSettings() unless given.
            bounds: lower and upper corner of the workspace, points outside of which are left out;
                around the points and V unless given.
            sights: what sensors at known places measured, see `freespace`; their lines of sight
                prove gaps in surfaces, see `layers`.
            beyond_volume: things up to 0.5 m outside V count for the clearance; false is the
                paper's definition.
            noise: metres, of points that lie on their surfaces already; estimated, and removed,
                unless given.

        Raises:
            CloudError: see `ObstacleSet.from_points`.
            VolumeError: see `require_room`.
        """
        grid, regions = grid or GridSettings(), regions or RegionSettings()
        require_room(volume, grid.cell_size)
        cloud = crop_cloud(points, bounds, (volume.lower, volume.upper), grid.cell_size)
        step("making the obstacle set of the clouds")
        measured = ObstacleSet.of_cloud(cloud.points, grid, *cloud.held, noise)
        step("finding planes")
        around = volume.lower - CAP, volume.upper + CAP
        seen = tuple(view.towards(*around, grid.cell_size) for view in sights)
        planes = Planes.of(measured, volume, regions)
        step("finding level placement regions")
        found, support = find_regions(measured, volume, regions, planes, LEVEL, seen)
        inclines = []
        beyond = CAP if beyond_volume else 0.0
        for slope in planes.slopes:
            step("finding sloping placement regions")
            more, sloping = find_regions(measured, volume, regions, planes, slope, seen)
            inclines.append(Incline(slope, sloping, measured, volume, beyond))
            found = largest_regions((*found, *more), regions)
        return cls(
            measured,
            found,
            support,
            measured,
            volume,
            cloud.finite,
            cloud.extent,
            beyond_volume,
            tuple(inclines),
            planes.steep,
            regions.max_slope,
            seen_space=SeenSpace.around(measured, seen, volume, *cloud.reach) if seen else None,
        )


def level_with_largest(regions: tuple[Region, ...]) -> tuple[Region, ...]:
    """Those of the surface that has most area in all, and of others as high as it."""
    area: dict[tuple[Slope, float], float] = {}
    for region in regions:  # large surfaces are cut into several, of one height
        key = region.slope, region.z
        area[key] = area.get(key, 0.0) + region.area
    if not area:
        return ()
    slope, z = max(area, key=lambda key: area[key])
    return tuple(r for r in regions if r.slope == slope and abs(r.z - z) <= CONTACT_TOLERANCE_M)


def find_regions(
    measured: ObstacleSet,
    volume: TargetVolume,
    settings: RegionSettings | None = None,
    planes: Planes | None = None,
    slope: Slope = LEVEL,
    sights: Sequence[View] = (),
) -> tuple[tuple[Region, ...], SupportMap]:
    """R of one slope in V, larger first, and what answers s(x) on its surfaces.

    Args:
        planes: of what was measured, sought unless given.
        sights: what sensors at known places measured: what they saw below a surface opens it.
    """
    settings = settings or RegionSettings()
    if planes is None:
        planes = Planes.of(measured, volume, settings)
    tops = planes.tops[slope]
    size, noise = measured.cell_size, measured.noise
    cloud = SlopeCloud(measured.points, volume, slope, tops, size, noise, sights)
    step("finding surfaces and their ends")
    support, layers = SupportMap.of_surfaces(
        cloud, measured.cell_size, settings.height_tolerance, CONTACT_TOLERANCE_M
    )
    step("finding regions of surfaces")
    return regions_of_layers(layers, support.trim, slope, volume, settings), support
