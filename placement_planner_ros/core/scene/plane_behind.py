"""The plane that passes behind a point, as the pixels around it tell.

Of a plane, 1 / range is linear in the direction: n · x = d at x = range · direction. So a plane is
three numbers around a point, and RANSAC (Fischler and Bolles, 1981) finds it among the pixels of a
window, whatever else is seen there.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from placement_planner_ros.core.kernels import kernel
from placement_planner_ros.core.scene.seen_pixels import Index, Seen
from placement_planner_ros.core.types import Array

Flags = npt.NDArray[np.int8]

_DRAWS = 24
"""Planes through three pixels that are tried: of a surface on half of the window one is missed in
25 times, ..."""
_ENOUGH = 0.6
"""... fewer where one is on so many of its pixels."""
_FEWEST = 12
"""Pixels that a plane needs; a third of a window, so that it does not follow from noise."""
_FLAT = 1.5
"""Square pixels that three must span, twice the triangle."""
_FEWEST_IN_BIN = 7
"""Points that one plane needs in a bin, of 12, ..."""
_WITHOUT = 4
"""... so many others left out, ..."""
_CLOSE = 0.5
"""... each within this times the tolerance of it."""
_LEFT_OUT = -1


@kernel(lean=True)
def before_plane(seen: Seen, p: int, q: int, plane: Array) -> float:
    """How far point q, near point p, is before the plane along its ray, metres.

    Args:
        plane: (3,) of `plane_behind`.
    """
    u = (seen.at[q, 0] - seen.at[p, 0]) / seen.pitch
    v = (seen.at[q, 1] - seen.at[p, 1]) / seen.pitch
    # To first order: range² (1 / range - 1 / range of the plane).
    return (1.0 / seen.range[q] - plane[0] - plane[1] * u - plane[2] * v) * seen.range[p] ** 2


@kernel(lean=True)
def _through(seen: Seen, p: int, i: int, j: int, k: int, plane: Array) -> bool:
    """Fill in the plane through three points; False where they are almost in line."""
    ux = (seen.at[j, 0] - seen.at[i, 0]) / seen.pitch
    uy = (seen.at[j, 1] - seen.at[i, 1]) / seen.pitch
    vx = (seen.at[k, 0] - seen.at[i, 0]) / seen.pitch
    vy = (seen.at[k, 1] - seen.at[i, 1]) / seen.pitch
    area = ux * vy - uy * vx
    if abs(area) < _FLAT:
        return False
    at_i = 1.0 / seen.range[i]
    b, c = 1.0 / seen.range[j] - at_i, 1.0 / seen.range[k] - at_i
    plane[1] = (b * vy - c * uy) / area
    plane[2] = (c * ux - b * vx) / area
    x, y = (
        (seen.at[i, 0] - seen.at[p, 0]) / seen.pitch,
        (seen.at[i, 1] - seen.at[p, 1]) / seen.pitch,
    )
    plane[0] = at_i - plane[1] * x - plane[2] * y
    return True


@kernel(lean=True)
def _look_around(seen: Seen, p: int, near: Index, count: int, window: Array) -> None:
    """Fill in (count, 3) of points around point p: how far beside it, in pixels, and 1 / range."""
    for i in range(count):
        window[i, 0] = (seen.at[near[i], 0] - seen.at[p, 0]) / seen.pitch
        window[i, 1] = (seen.at[near[i], 1] - seen.at[p, 1]) / seen.pitch
        window[i, 2] = 1.0 / seen.range[near[i]]


@kernel(lean=True)
def _off_plane(window: Array, i: int, plane: Array, square: float) -> float:
    """`before_plane` of point i around another one, whose range has that square, m²."""
    return (window[i, 2] - plane[0] - plane[1] * window[i, 0] - plane[2] * window[i, 1]) * square


@kernel(lean=True)
def _refit(window: Array, count: int, tolerance: float, square: float, plane: Array) -> int:
    """Fit the plane anew to its pixels by least squares; returns how many it had."""
    n = sx = sy = sz = xx = xy = yy = xz = yz = 0.0
    for i in range(count):
        if abs(_off_plane(window, i, plane, square)) > tolerance:
            continue
        x, y, z = window[i, 0], window[i, 1], window[i, 2]
        n += 1.0
        sx += x
        sy += y
        sz += z
        xx += x * x
        xy += x * y
        yy += y * y
        xz += x * z
        yz += y * z
    if n < _FEWEST:
        return int(n)
    xx, xy, yy = xx - sx * sx / n, xy - sx * sy / n, yy - sy * sy / n
    xz, yz = xz - sx * sz / n, yz - sy * sz / n
    area = xx * yy - xy * xy
    if area < n:  # its pixels are almost in line
        return 0
    plane[1] = (xz * yy - yz * xy) / area
    plane[2] = (yz * xx - xz * xy) / area
    plane[0] = (sz - plane[1] * sx - plane[2] * sy) / n
    return int(n)


@kernel(lean=True)
def plane_behind(
    seen: Seen, p: int, near: Index, count: int, tolerance: float, window: Array, plane: Array
) -> bool:
    """Whether some of the pixels around point p are of one plane that passes behind it.

    Args:
        near: the first `count` are the points around it.
        tolerance: by which points may be off the plane along their rays, and beyond which it is
            behind, metres.
        window: (k, 3) room for the points around it.
        plane: (3,) receives 1 / range at point p, and by how much it grows per pixel.
    """
    if count < _FEWEST:
        return False
    best, a, b, c = 0, 0.0, 0.0, 0.0
    _look_around(seen, p, near, count, window)
    square = seen.range[p] ** 2
    draw = 12345
    for _ in range(_DRAWS):
        draw = (draw * 1103515245 + 12345) % 2147483648
        i = near[(draw >> 8) % count]
        draw = (draw * 1103515245 + 12345) % 2147483648
        j = near[(draw >> 8) % count]
        draw = (draw * 1103515245 + 12345) % 2147483648
        k = near[(draw >> 8) % count]
        if not _through(seen, p, i, j, k, plane) or before_plane(seen, p, p, plane) <= tolerance:
            continue
        on_it = 0
        for m in range(count):
            on_it += abs(_off_plane(window, m, plane, square)) <= tolerance
        if on_it > best:
            best, a, b, c = on_it, plane[0], plane[1], plane[2]
        if best > _ENOUGH * count:
            break
    if best < _FEWEST:
        return False
    plane[0], plane[1], plane[2] = a, b, c
    for _ in range(2):
        if _refit(window, count, tolerance, square, plane) < _FEWEST:
            return False
    return before_plane(seen, p, p, plane) > tolerance


@kernel(lean=True)
def on_plane(seen: Seen, cell: int, tolerance: float, found: Flags) -> None:
    """Mark with 1 the points of a bin that lie in one plane: quick, and enough for most points.

    Least squares, without the worst point until all others are close to the plane.

    Args:
        tolerance: metres, a spacing of pixels at least.
        found: (n,) of all points, 0 so far.
    """
    first, last = seen.start[cell], seen.start[cell + 1]
    if last - first < _FEWEST_IN_BIN:
        return
    a, b, r = seen.at[first, 0], seen.at[first, 1], seen.range[first]
    close = _CLOSE * max(tolerance, seen.pitch * r) / (r * r)
    n = sx = sy = sz = xx = xy = yy = xz = yz = 0.0
    left_out = -1
    worst = np.inf
    for k in range(_WITHOUT + 2):
        # all points, then all but the worst, whose share is taken away
        for q in range(first if k == 0 else left_out, last if k == 0 else left_out + 1):
            sign = 1.0 if k == 0 else -1.0
            x, y = (seen.at[q, 0] - a) / seen.pitch, (seen.at[q, 1] - b) / seen.pitch
            z = 1.0 / seen.range[q] - 1.0 / r
            n += sign
            sx += sign * x
            sy += sign * y
            sz += sign * z
            xx += sign * x * x
            xy += sign * x * y
            yy += sign * y * y
            xz += sign * x * z
            yz += sign * y * z
        c_xx, c_xy, c_yy = xx - sx * sx / n, xy - sx * sy / n, yy - sy * sy / n
        c_xz, c_yz = xz - sx * sz / n, yz - sy * sz / n
        area = c_xx * c_yy - c_xy * c_xy
        if area < n:  # they are almost in line
            break
        along_x, along_y = (c_xz * c_yy - c_yz * c_xy) / area, (c_yz * c_xx - c_xz * c_xy) / area
        at = (sz - along_x * sx - along_y * sy) / n
        worst, left_out = 0.0, -1
        for q in range(first, last):
            x, y = (seen.at[q, 0] - a) / seen.pitch, (seen.at[q, 1] - b) / seen.pitch
            off = abs(1.0 / seen.range[q] - 1.0 / r - at - along_x * x - along_y * y)
            if found[q] == 0 and off > worst:
                worst, left_out = off, q
        if worst <= close or n <= _FEWEST_IN_BIN:
            break
        found[left_out] = _LEFT_OUT
    for q in range(first, last):
        found[q] = 1 if worst <= close and found[q] == 0 else 0
