"""s(x) by polygon: the centre of mass is well within the hull of what is supported."""

from __future__ import annotations

import functools
import math

import numpy as np
from numba import njit

from placement_planner_ros.core.body.contact_points import contact_points
from placement_planner_ros.core.contacts.coplanarity import MAX_LEAN_SLOPE
from placement_planner_ros.core.contacts.protrusions import Protrusions
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.scene.spans import Footprint, spans
from placement_planner_ros.core.types import Array, Index, Mask, Slope, upright
from placement_planner_ros.core.uncounted import Uncounted

TIPS = math.radians(5.0)
"""By so much, at least, an object can be tipped before it falls, from how it stands."""


class PolygonSupport:
    """The centre of mass, along gravity, lies in the hull of the contact points that are supported.

    The hull is shrunk by `support_margin`. Contact points are those of the body's own surface that
    touch the contact plane. Of points whose surface is far below what the highest of them carry,
    none counts, for the object would not come to touch it.

    Attributes:
        faces: F, the foot of the centre of mass as their reference point.
    """

    def __init__(self, problem: Problem, footing: SupportSettings) -> None:
        body = problem.body
        self.faces = tuple(face.over(body.center_of_mass) for face in body.faces)
        self.footing = footing
        self._problem = problem
        # The centre of mass over each face, and the points that touch.
        centers = [face.T_face_object.act(body.center_of_mass) for face in self.faces]
        self.heights = np.array([center[2] for center in centers])
        self._contacts = [contact_points(body, face) for face in self.faces]
        self._spread = [each.points[each.spread] for each in self._contacts]
        self._others = [  # none, where the former are all
            each.points[: len(each.points) if len(each.spread) < len(each.points) else 0]
            for each in self._contacts
        ]
        far = [np.linalg.norm(each.points, axis=1) for each in self._contacts]
        self.radii = np.array([np.max(each, initial=0.0) for each in far])
        self._rises = Protrusions(
            problem.environment,
            self.faces,
            lambda face: self._contacts[face].points,
            footing.contact_tolerance,
        )

    @functools.cached_property
    def regions(self) -> tuple[Region, ...]:
        """Where, above which surfaces, the centre of mass may come to be: see `spans`."""
        if not self.faces:
            return ()
        footprint = Footprint(
            float(self.radii.max()),
            self.footing.support_margin,
            (float(self.heights.min()), float(self.heights.max())),
        )
        return spans(self._problem.environment, footprint, self.footing.contact_tolerance)

    def stable(self, T: Array, faces: Index, slope: Slope) -> Mask:
        """(n,) s(x) of poses (n, 4, 4) on these faces (n,) and one slope.

        Points that are spread over what touches are looked at first; where these do not suffice,
        all are. In noisy clouds nothing is left of thin bars without what noise may have added to
        them; so at last those points are looked at that are supported by surfaces as measured. What
        truly carries lies within so much of each, where the object touches, too, and the hull is
        shrunk by as much more.
        """
        # The points that span the contact, then all, then those with room around.
        added = self._problem.environment.support_of(slope).trim
        looks = [(self._spread, 0.0), (self._others, 0.0)]
        if added > 0.0:
            looks.append(([each.points[each.room >= added] for each in self._contacts], added))
        stable = np.zeros(len(T), np.bool_)
        for points, beyond in looks:
            rest = np.flatnonzero(~stable)
            if len(rest):
                stable[rest] = self._firm(points, T[rest], faces[rest], slope, beyond)
        return stable

    def _firm(
        self, points: list[Array], T: Array, faces: Index, slope: Slope, added: float
    ) -> Mask:
        """(n,) whether those of the contact points that are supported carry the object.

        Nothing rises above these anywhere under what touches, either: of what is narrower than
        contact points are apart, these may tell nothing.

        Args:
            points: (k, 2) of each face.
            added: m that surfaces may reach beyond their true ends, and are taken to.
        """
        # Poses on one face together.
        widths, planes, noise = np.zeros(len(T)), np.zeros((len(T), 3)), np.zeros(len(T))
        for face in np.unique(faces):
            if len(points[face]):
                on = np.flatnonzero(faces == face)
                found = self._carried(points[face], T[on], int(face), slope, added)
                widths[on], planes[on], noise[on] = found
        # Those that carry, unless something under them lifts the object.
        firm = np.asarray(widths > 0.0)
        rows = np.flatnonzero(firm)
        if len(rows):
            firm[rows] = ~self._rises.lift(
                T[rows], faces[rows], slope, planes[rows], widths[rows], noise[rows]
            )
        return firm

    def _carried(
        self, points: Array, T: Array, face: int, slope: Slope, added: float
    ) -> tuple[Array, Array, Array]:
        """What `_firm_support` says of poses on one face; (n,) m that heights may be off by."""
        environment = self._problem.environment
        inward = self.faces[face].T_face_object.inverse()
        # The contact points at each pose, and how far the surface is above each.
        in_object = points @ inward.rotation[:, :2].T + inward.translation
        placed = in_object @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3]
        support = environment.support_of(slope)
        gaps = support.gaps(
            placed.reshape(-1, 3), self.footing.contact_tolerance, None if added else 0.0
        ).reshape(len(T), -1)
        noise = np.full(len(T), support.height_noise)
        if added:  # what carries fewer than half may be thin bars, told by few points each
            few = 2 * np.isfinite(gaps).sum(axis=1) < gaps.shape[1]
            noise[few] = environment.measured.noise
        ups = np.ascontiguousarray(T[:, 2, :3] @ inward.rotation)
        margin, height = self.footing.support_margin, float(self.heights[face])
        widths, planes = _firm_support(points, gaps, ups, height, margin, noise, added)
        return widths, planes, noise

    def least_inside(self, face: Index, slope: Array) -> tuple[Array, Array]:
        """How far the centre of mass is shifted, and what it keeps from the end of its support.

        Args:
            face: (n,) faces.
            slope: (n, 2) of the planes that they stand on.

        Returns:
            (n, 2) m from the reference point to where it lies along gravity; (n,) m at least that
            supported points reach beyond that in all directions, seen from above.
        """
        # Gravity's lean shifts the foot; the margin, or what tipping takes on level ground.
        shift = self.heights[face, None] * upright(slope)[:, :2, 2]
        keeps = np.full(len(face), self.footing.support_margin)
        level = ~slope.any(axis=1)
        keeps[level] = np.maximum(keeps[level], math.tan(TIPS) * self.heights[face[level]])
        return shift, keeps / np.sqrt(1.0 + (slope * slope).sum(axis=1))


@njit(cache=True, nogil=True)
def _firm_support(
    points: Array, gaps: Array, ups: Array, height: float, margin: float, noise: Array, added: float
) -> tuple[Array, Array]:
    """Whether the supported points carry the object so that it stays, and how their plane lies.

    Args:
        points: (k, 2) contact points in lexicographic order, about the foot of the centre of mass.
        gaps: (n, k) m, how far the surface is above each; NaN without.
        ups: (n, 3) against gravity, in the frame of the points.
        height: of the centre of mass above them, metres.
        margin: from the foot along gravity to the end of the hull, at least, metres.
        noise: (n,) m that heights may be off by.
        added: m that the hull may reach beyond what carries.

    Returns:
        (n,) m across the hull, where it is narrowest; 0 where the object does not stay. (n, 3) the
        plane of what carries: how far above the foot, and by how much it rises along the axes.
    """
    widths, planes = np.zeros(len(gaps)), np.zeros((len(gaps), 3))
    hull = np.empty(2 * len(points) + 2, np.int64)
    carries = np.empty(len(points), np.bool_)
    # Which points carry the object, if their plane does not lean too much.
    for n in range(len(gaps)):
        if not _carrying_points(points, gaps[n], noise[n], carries, planes[n]):
            continue
        corners = _convex_hull(points, carries, hull)
        if corners < 3:
            continue
        # from the foot of the centre of mass to the point under it along gravity
        under_x = -height * ups[n, 0] / ups[n, 2]
        under_y = -height * ups[n, 1] / ups[n, 2]
        firm = True
        # Each side of the hull: its direction, and the one into the hull.
        for c in range(corners):
            a, b = hull[c], hull[(c + 1) % corners]
            along_x, along_y = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
            length = math.sqrt(along_x * along_x + along_y * along_y)
            in_x, in_y = -along_y / length, along_x / length
            # How far the foot lies within the side.
            inside = -(in_x * points[a, 0] + in_y * points[a, 1]) - added
            # The angle by which the object can be tipped over that side, gravity's own lean taken
            # off.
            net = math.atan2(inside, height)
            net -= math.atan2(in_x * ups[n, 0] + in_y * ups[n, 1], ups[n, 2])
            # The point under the centre of mass keeps the margin, and the object can be tipped that
            # far.
            if inside + in_x * under_x + in_y * under_y < margin or net < TIPS:
                firm = False
                break
        if firm:
            widths[n] = _narrowest_width(points, hull[:corners])
    return widths, planes


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _carrying_points(points: Array, gaps: Array, noise: float, carries: Mask, plane: Array) -> bool:
    """Which points carry the object; whether the surface under them does not lean, at all.

    As `coplanar_support`, for a varying number of points. What lies lower than so little a lean
    would bridge is not touched.

    Args:
        plane: (3,) receives that of those which carry.
    """
    # Points with a surface under them, and the plane fitted to it.
    for k in range(len(points)):
        carries[k] = not math.isnan(gaps[k])
    width = _fit_plane(points, gaps, carries, plane)
    if width == 0.0:
        return False
    # The plane may lean by `MAX_LEAN_SLOPE`, and by what noise makes of so short a width.
    allowed = MAX_LEAN_SLOPE + noise / width
    if math.sqrt(plane[1] * plane[1] + plane[2] * plane[2]) > allowed:
        return False
    # The highest surface about the plane.
    highest = -np.inf
    for k in range(len(points)):
        if carries[k]:
            above = gaps[k] - plane[1] * points[k, 0] - plane[2] * points[k, 1]
            highest = max(highest, above)
    # Keep those points under which it is not lower than the lean would bridge.
    lowest = highest - 0.5 * allowed * width - 0.5 * noise
    for k in range(len(points)):
        if carries[k]:
            above = gaps[k] - plane[1] * points[k, 0] - plane[2] * points[k, 1]
            carries[k] = above >= lowest
    return _fit_plane(points, gaps, carries, plane) > 0.0


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _fit_plane(points: Array, gaps: Array, of: Mask, plane: Array) -> float:
    """m across some of the points, where they are narrowest; 0 where they are in line.

    Args:
        plane: (3,) receives what is fitted to their gaps: how much at the origin, along x and y.
    """
    # The mean of the points and of their gaps.
    count, mean_x, mean_y, mean = 0, 0.0, 0.0, 0.0
    for k in range(len(points)):
        if of[k]:
            count += 1
            mean_x += points[k, 0]
            mean_y += points[k, 1]
            mean += gaps[k]
    if count < 3:
        return 0.0
    mean_x, mean_y, mean = mean_x / count, mean_y / count, mean / count
    # Second moments of the points, and of points with gaps.
    xx, xy, yy, fall_x, fall_y = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(points)):
        if of[k]:
            x, y, z = points[k, 0] - mean_x, points[k, 1] - mean_y, gaps[k] - mean
            xx += x * x
            xy += x * y
            yy += y * y
            fall_x += x * z
            fall_y += y * z
    # Points in line determine no plane.
    determinant = xx * yy - xy * xy
    if determinant <= 1e-9 * (xx + yy) ** 2:
        return 0.0
    # Least squares: slopes along the axes, and the value at the origin.
    plane[1] = (yy * fall_x - xy * fall_y) / determinant
    plane[2] = (xx * fall_y - xy * fall_x) / determinant
    plane[0] = mean - plane[1] * mean_x - plane[2] * mean_y
    # The smaller principal moment gives the width across.
    least = 0.5 * (xx + yy - math.sqrt((xx - yy) ** 2 + 4.0 * xy * xy))
    return 2.0 * math.sqrt(least / count)


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _narrowest_width(points: Array, corners: Index) -> float:
    """m between the two parallel lines, closest together, that hold a convex polygon.

    Args:
        corners: rows of the points (k, 2), in boundary order.
    """
    narrowest = np.inf
    # Each side, and the corner furthest from it.
    for c in range(len(corners)):
        a, b = corners[c], corners[(c + 1) % len(corners)]
        along_x, along_y = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
        length = math.sqrt(along_x * along_x + along_y * along_y)
        farthest = 0.0
        for k in corners:
            off = along_x * (points[k, 1] - points[a, 1]) - along_y * (points[k, 0] - points[a, 0])
            farthest = max(farthest, off / length)
        narrowest = min(narrowest, farthest)
    return narrowest


@njit(cache=True, nogil=True, pipeline_class=Uncounted)
def _convex_hull(points: Array, of: Mask, hull: Index) -> int:
    """Rows of the corners of the convex hull of some of the points (k, 2), sorted, anticlockwise.

    Returns:
        How many they are; they stand at the beginning of `hull`.
    """
    # The lower chain from left to right, then the upper one from right to left.
    count = 0
    for upper in range(2):
        begin = count
        for step in range(len(points)):
            k = len(points) - 1 - step if upper == 1 else step
            if not of[k]:
                continue
            # Take back corners at which the chain does not turn left.
            while count - begin >= 2:
                a, b = hull[count - 2], hull[count - 1]
                turn = (points[b, 0] - points[a, 0]) * (points[k, 1] - points[a, 1]) - (
                    points[b, 1] - points[a, 1]
                ) * (points[k, 0] - points[a, 0])
                if turn > 0.0:
                    break
                count -= 1
            hull[count] = k
            count += 1
        count -= 1  # the last of one chain is the first of the other
    return count
