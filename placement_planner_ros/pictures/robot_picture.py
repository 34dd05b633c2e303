"""A picture of a robot as the planner has it: at the start, its cover, and each grasp."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy.spatial import ConvexHull, QhullError

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.pictures.picture import (
    HAND,
    OVERSAMPLING,
    PLACED,
    VOLUME,
    averaged,
    box_corners,
    draw_volume,
    moved,
    robot_meshes,
)
from placement_planner_ros.pictures.plots import new_figure
from placement_planner_ros.pictures.rendering import Mesh, Viewpoint, joined, render
from placement_planner_ros.scenes.primitives import Colour

_COVER: tuple[Colour, ...] = (
    (0.90, 0.45, 0.10),
    (0.10, 0.55, 0.80),
    (0.85, 0.70, 0.10),
    (0.55, 0.25, 0.70),
    (0.10, 0.60, 0.40),
    (0.80, 0.20, 0.35),
)
_AXES = ("#d62728", "#2ca02c", "#1f77b4")
_AXIS = 0.1
_IN_A_ROW = 4
_MOST_GRASPS = 8
_WIDTH, _HEAD, _TOP, _ROW, _FOOT = 14.0, 0.45, 6.6, 3.6, 0.55
"""Inches: of the picture; of a title, the row of the two large panels, each row of grasps and the
legend."""
_TOWARDS_EYE = (-0.9, 0.45)
"""Azimuth and elevation, rad."""


def draw_robot(
    path: Path, robot: Robot, q: Array, arms: Sequence[Arm], body: Body | None, volume: TargetVolume
) -> None:
    """Write a PNG: the robot at q (nq,) with V, the convex parts over its meshes, and each grasp.

    The first eight grasps have a panel of their own, with the hand open where it can be opened.
    """
    grasps = [(arm, number) for arm in arms for number in range(len(arm.grasps))]
    grasps = [] if body is None else grasps[:_MOST_GRASPS]
    rows = -(-len(grasps) // _IN_A_ROW)
    height = _TOP + rows * _ROW + _FOOT
    figure = new_figure(_WIDTH, height, constrained=False)

    grid = figure.add_gridspec(
        1 + rows,
        _IN_A_ROW,
        height_ratios=[_TOP] + [_ROW] * rows,
        left=0.005,
        right=0.995,
        bottom=_FOOT / height,
        top=1.0 - _HEAD / height,
        wspace=0.02,
        hspace=_HEAD * (1 + rows) / (height - _FOOT - _HEAD * (1 + rows)),
    )

    def panel(place: SubplotSpec, title: str) -> Axes:
        axes = figure.add_subplot(place)
        axes.set_axis_off()
        axes.set_title(title, fontsize=11, pad=4)
        return axes

    hand = [link for arm in arms for link in arm.touch_links]
    links = robot_meshes(robot, q, hand)
    poses = [robot.link_pose(q, arm.tip_frame) for arm in arms]
    held = [
        Mesh(moved(body.vertices, T * arm.grasps[0]), _hull_triangles(body.vertices), PLACED)
        for arm, T in zip(arms, poses, strict=True)
        if body is not None and arm.grasps
    ]
    corners = box_corners(volume.lower, volume.upper)
    shown = np.vstack([mesh.vertices for mesh in links + held] + [corners])
    axes = panel(grid[0, :2], f"{robot.name} at the start, first grasp of each arm")
    _show_view(axes, shown, links + held, poses, volume)

    parts, count = _cover_meshes(robot, q)
    covered = f"{count} convex parts over the meshes" if count else "no mesh needs convex parts"
    axes = panel(grid[0, 2:], covered)
    robots = np.vstack([mesh.vertices for mesh in links]) if links else corners
    _show_view(axes, robots, links + parts, [], None)

    for k, (arm, number) in enumerate(grasps):
        assert body is not None
        opened = robot.with_open_hand(q, arm) if arm.gripper_joints else q
        T_tip = robot.link_pose(opened, arm.tip_frame)
        thing = Mesh(
            moved(body.vertices, T_tip * arm.grasps[number]),
            _hull_triangles(body.vertices),
            PLACED,
            0.75,
        )
        of_hand = [
            mesh
            for mesh, link in zip(
                robot_meshes(robot, opened, arm.touch_links), robot.geometry_links, strict=True
            )
            if link in arm.touch_links
        ]
        place = grid[1 + k // _IN_A_ROW, k % _IN_A_ROW]
        state = "open hand" if arm.gripper_joints else "hand"
        axes = panel(place, f"{arm.name}, grasp {number}, {state}")
        near = np.vstack([mesh.vertices for mesh in [*of_hand, thing]] + [T_tip.translation[None]])
        _show_view(axes, near, [*of_hand, thing], [T_tip], None)
    _add_legend(figure, bool(held), count > 0)
    figure.savefig(path)


def _show_view(
    axes: Axes,
    points: Array,
    meshes: Sequence[Mesh],
    tips: Sequence[pin.SE3],
    volume: TargetVolume | None,
) -> None:
    """A view of all points (n, 3), with the axes of the tips and V drawn over it."""
    width, height = (int(side) * OVERSAMPLING for side in axes.bbox.size)
    view = Viewpoint.around(points, *_TOWARDS_EYE, width, height)
    image = render(view, list(meshes))
    colours = averaged(image.colours)
    axes.imshow(colours, extent=(0, width, height, 0), interpolation="nearest", aspect="auto")
    if volume is not None:
        draw_volume(axes, view, image, volume)
    for T in tips:
        ends = T.translation + _AXIS * np.vstack([np.zeros(3), T.rotation.T])
        u, v = view.project(ends)[:, :2].T
        for axis, colour in enumerate(_AXES, 1):
            axes.plot(u[[0, axis]], v[[0, axis]], color=colour, linewidth=2.2)
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)


def _hull_triangles(vertices: Array) -> npt.NDArray[np.int64]:
    try:
        hull = ConvexHull(vertices)
    except QhullError:  # flat
        hull = ConvexHull(vertices, qhull_options="QJ")
    return np.asarray(hull.simplices, dtype=np.int64)


def _cover_meshes(robot: Robot, q: Array) -> tuple[list[Mesh], int]:
    """The parts of all covers at q (nq,), those of one colour as one mesh, and how many."""
    parts = [
        moved(part, T)
        for cover, T in zip(robot.covers, robot.geometry_poses(q), strict=True)
        if cover is not None
        for part in cover.parts
    ]
    meshes = [
        Mesh(part, _hull_triangles(part), _COVER[k % len(_COVER)], 0.4)
        for k, part in enumerate(parts)
    ]
    return joined(meshes), len(parts)


def _add_legend(figure: Figure, held: bool, covered: bool) -> None:
    entries: list[Patch | Line2D] = [
        Line2D([], [], color=colour, linewidth=2.2, label=f"{name} of a tip, 10 cm")
        for name, colour in zip("xyz", _AXES, strict=True)
    ]
    entries += [Patch(color=VOLUME, label="target volume"), Patch(color=HAND, label="touch links")]
    if held:
        entries.append(Patch(color=PLACED, label="object"))
    if covered:
        entries.append(Patch(color=_COVER[0], alpha=0.5, label="convex parts"))
    figure.legend(
        handles=entries, loc="lower center", ncols=len(entries), fontsize=10, frameon=False
    )
