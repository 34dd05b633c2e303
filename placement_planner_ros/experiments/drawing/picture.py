"""Pictures for people: a placement in its scene, and the objective over time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin
import trimesh
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from scipy.ndimage import maximum_filter
from scipy.spatial import ConvexHull

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.experiments.drawing.rendering import (
    Image,
    Mesh,
    View,
    render,
    render_points,
)
from placement_planner_ros.scenes.primitives import Colour, ConvexPrimitive
from placement_planner_ros.scenes.scenes import Scene

Triangles = npt.NDArray[np.int64]

_PLACED: Colour = (0.15, 0.70, 0.25)
_START: Colour = (0.55, 0.55, 0.60)
_LINK: Colour = (0.88, 0.88, 0.90)
_HAND: Colour = (0.35, 0.36, 0.42)
_REGION: Colour = (0.20, 0.45, 0.90)
_VOLUME: Colour = (0.85, 0.15, 0.55)
_SEE_THROUGH = 0.28
_CLOSE_BY = 0.3
_PLATE = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "boxstyle": "round"}
_OVERSAMPLING = 2
_SIZE, _DPI = (10.0, 7.5), 110


def draw_placement(
    path: str | Path,
    *,
    robot: Robot,
    q: Array,
    body_vertices: Array,
    body_triangles: Triangles,
    T_world_object: pin.SE3,
    scene: Scene | None = None,
    cloud: Array | None = None,
    volume: TargetVolume | None = None,
    regions: Iterable[tuple[Array, float]] = (),
    T_world_start: pin.SE3 | None = None,
    hand_links: Sequence[str] = (),
    title: str = "",
    azimuth: float = -2.3,
    elevation: float = 0.62,
) -> None:
    """Write a PNG: the scene, V, and the robot that has just put the object down.

    Whatever part of scene or robot stands between the eye and the object is see-through.

    Args:
        q: (nq,) final configuration.
        body_vertices, body_triangles: (n, 3) and (t, 3), the object in its own frame.
        scene: drawn as solids; or
        cloud: (n, 3) measured points, drawn where there is no scene, coloured by height.
        volume: V; the scene's where not given.
        regions: placement regions as ((k, 4) rectangles xmin ymin xmax ymax, height).
        T_world_start: where the object was at first, drawn as a ghost.
        hand_links: links in the darker colour, such as an arm's touch links.
        azimuth, elevation: direction from the scene to the eye, rad; the default looks over the
            robot's right shoulder.
    """
    if volume is None and scene is not None:
        volume = scene.volume
    placed = _moved(body_vertices, T_world_object)
    links = _robot_meshes(robot, q, hand_links)
    parts = () if scene is None else scene.parts
    width, height = (int(side * _DPI * _OVERSAMPLING) for side in _SIZE)
    view = View.around(_shown(placed, volume, links), azimuth, elevation, width, height)
    triangles = np.asarray(body_triangles, dtype=np.int64)
    hiding = _hiding(view, placed, [*(p.vertices for p in parts), *(m.vertices for m in links)])
    meshes = [Mesh(placed, triangles, _PLACED)]
    for part, hides in zip(parts, hiding, strict=False):
        meshes.append(
            Mesh(part.vertices, part.triangles, part.colour, _SEE_THROUGH if hides else 1.0)
        )
    for mesh, hides in zip(links, hiding[len(parts) :], strict=True):
        alpha = _SEE_THROUGH if hides else 1.0
        meshes.append(Mesh(mesh.vertices, mesh.triangles, mesh.colour, alpha))
    for rectangles, z in regions:
        meshes.extend(_region_meshes(np.asarray(rectangles), z))
    if T_world_start is not None:
        meshes.append(Mesh(_moved(body_vertices, T_world_start), triangles, _START, 0.5))
    image = render(view, meshes)
    if cloud is not None and scene is None:
        points = cloud[_beside(view, cloud, meshes[0])]
        image = render_points(view, image, points, _height_colours(points), size=0.006)

    figure = Figure(figsize=_SIZE, dpi=_DPI)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(_averaged(image.colours), extent=(0, width, height, 0), interpolation="nearest")
    axes.set_axis_off()
    if volume is not None:
        _draw_volume(axes, view, image, volume)
    _draw_frame(axes, view)
    entries = [Patch(color=_PLACED, label="placed object")]
    if volume is not None:
        size = " × ".join(f"{side:.2f}" for side in volume.upper - volume.lower)
        entries.append(Patch(color=_VOLUME, label=f"target volume, {size} m"))
    if any(mesh.colour == _REGION for mesh in meshes):
        entries.append(Patch(color=_REGION, alpha=0.5, label="placement regions"))
    if T_world_start is not None:
        entries.append(Patch(color=_START, alpha=0.5, label="object at the start"))
    axes.legend(handles=entries, loc="upper right", fontsize=10, framealpha=0.9)
    if title:
        axes.text(0.02, 0.97, title, transform=axes.transAxes, va="top", fontsize=13, bbox=_PLATE)
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    figure.savefig(path)


def draw_objective(
    path: str | Path,
    series: Mapping[str, Sequence[tuple[float, float]]],
    *,
    end: float | None = None,
    objective: str = "objective ξ [m]",
    title: str = "",
) -> None:
    """Write a PNG: the best objective over time as steps, one line per series.

    Args:
        series: name -> (seconds since start, objective) of every improvement, in order.
        end: seconds at which the runs ended; the steps are drawn up to there.
    """
    figure = Figure(figsize=(8.0, 4.5), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    last = max((steps[-1][0] for steps in series.values() if steps), default=1.0)
    end = 1.05 * last if end is None else end
    for name, steps in series.items():
        if not steps:
            axes.plot([], [], label=f"{name} (no solution)")
            continue
        times = [time for time, _ in steps]
        values = [value for _, value in steps]
        (line,) = axes.step([*times, end], [*values, values[-1]], where="post", label=name)
        axes.plot(times, values, "o", color=line.get_color(), markersize=5)
        if len(series) == 1:
            axes.annotate(
                f"first after {times[0]:.2f} s",
                (times[0], values[0]),
                textcoords="offset points",
                xytext=(8, -4),
                va="top",
                fontsize=9,
            )
            axes.annotate(
                f"{values[-1]:.3f}",
                (end, values[-1]),
                textcoords="offset points",
                xytext=(-4, 5),
                ha="right",
                fontsize=9,
            )
    axes.set_xlim(0.0, end)
    axes.margins(y=0.12)
    axes.set_xlabel("time since start [s]")
    axes.set_ylabel(objective)
    axes.grid(alpha=0.3)
    if len(series) > 1 or not all(series.values()):
        axes.legend(fontsize=9)
    if title:
        axes.set_title(title)
    figure.savefig(path)


def _moved(vertices: Array, T: pin.SE3) -> Array:
    return np.asarray(np.asarray(vertices) @ T.rotation.T + T.translation)


def _box_corners(volume: TargetVolume) -> Array:
    """(8, 3): bit k of the row says whether coordinate k is the upper one."""
    upper = (np.arange(8)[:, None] >> np.arange(3)) & 1
    return np.where(upper == 1, volume.upper, volume.lower)


def _shown(placed: Array, volume: TargetVolume | None, links: Sequence[Mesh]) -> Array:
    """(n, 3) points the picture has to hold: the object, V, and the robot's part close by."""
    points = placed if volume is None else np.vstack([placed, _box_corners(volume)])
    low, high = points.min(axis=0) - _CLOSE_BY, points.max(axis=0) + _CLOSE_BY
    robot = np.vstack([mesh.vertices for mesh in links])
    near = ((robot > low) & (robot < high)).all(axis=1)
    return np.vstack([points, robot[near]])


def _averaged(colours: Array) -> Array:
    """Every `_OVERSAMPLING` squared pixels as one, which smooths edges."""
    n = _OVERSAMPLING
    height, width, _ = colours.shape
    return np.asarray(colours.reshape(height // n, n, width // n, n, 3).mean(axis=(1, 3)))


def _robot_meshes(robot: Robot, q: Array, hand_links: Sequence[str]) -> list[Mesh]:
    data, placements = robot.model.createData(), robot.geometry.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.geometry, placements, q)
    meshes = []
    for thing, link, T in zip(
        robot.geometry.geometryObjects, robot.geometry_links, placements.oMg, strict=True
    ):
        vertices, triangles = _shape_mesh(thing.geometry)
        colour = _HAND if link in hand_links else _LINK
        meshes.append(Mesh(_moved(vertices, T), triangles, colour))
    return meshes


def _shape_mesh(shape: coal.CollisionGeometry) -> tuple[Array, Triangles]:
    """Vertices (n, 3) and triangles (t, 3) of a collision shape in its own frame."""
    if isinstance(shape, coal.BVHModelBase):
        vertices = np.array(shape.vertices())
        indices = [[shape.tri_indices(i)[k] for k in range(3)] for i in range(shape.num_tris)]
        return vertices, np.array(indices, dtype=np.int64)
    if isinstance(shape, coal.ConvexBase):
        vertices = np.array(shape.points())
        return vertices, ConvexHull(vertices).simplices.astype(np.int64)
    if isinstance(shape, coal.Box):
        mesh = trimesh.creation.box(2 * np.asarray(shape.halfSide).ravel())
    elif isinstance(shape, coal.Sphere):
        mesh = trimesh.creation.icosphere(2, shape.radius)
    elif isinstance(shape, coal.Cylinder):
        mesh = trimesh.creation.cylinder(shape.radius, 2 * shape.halfLength)
    elif isinstance(shape, coal.Capsule):
        mesh = trimesh.creation.capsule(2 * shape.halfLength, shape.radius)
        mesh.apply_translation(-mesh.bounds.mean(axis=0))
    else:
        raise TypeError(f"cannot draw a {type(shape).__name__}")
    return np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64)


def _hiding(view: View, placed: Array, solids: Sequence[Array]) -> list[bool]:
    """Which solids (their hulls) stand between the eye and the object's corners or centre."""
    targets = np.vstack([placed, placed.mean(axis=0)])
    targets = targets[:: max(1, len(targets) // 40)]
    shares = np.linspace(0.3, 0.98, 120)[:, None, None]
    along = (view.eye + shares * (targets - view.eye)).reshape(-1, 3)
    result = []
    for vertices in solids:
        inside = ConvexPrimitive("", vertices).depth(along).reshape(len(shares), -1) > 1e-3
        result.append(bool(inside.any(axis=0).mean() > 0.1))
    return result


def _beside(view: View, cloud: Array, placed: Mesh) -> npt.NDArray[np.bool_]:
    """Which points (n,) of a cloud do not hide the object; those around it count as hiding too."""
    depth = render(view, [placed]).depth
    depth[~np.isfinite(depth)] = 0.0
    depth = maximum_filter(depth, size=view.width // 60)
    projected = view.project(cloud)
    u = np.clip(projected[:, 0], 0, view.width - 1).astype(int)
    v = np.clip(projected[:, 1], 0, view.height - 1).astype(int)
    return np.asarray(projected[:, 2] > depth[v, u])


def _region_meshes(rectangles: Array, z: float) -> list[Mesh]:
    meshes = []
    for x0, y0, x1, y1 in rectangles:
        corners = np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])
        corners[:, 2] += 0.001
        meshes.append(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), _REGION, 0.5))
    return meshes


def _height_colours(cloud: Array) -> Array:
    low, high = np.percentile(cloud[:, 2], [2, 98])
    share = np.clip((cloud[:, 2] - low) / max(high - low, 1e-6), 0, 1)[:, None]
    return np.asarray((1 - share) * np.array([0.45, 0.42, 0.40]) + share * [0.95, 0.80, 0.55])


def _draw_volume(axes: Axes, view: View, image: Image, volume: TargetVolume) -> None:
    """V's edges: solid where seen, dotted where something is in front."""
    corners = _box_corners(volume)
    for i in range(8):
        for axis in range(3):
            if not i >> axis & 1:
                ends = corners[[i, i | 1 << axis]]
                steps = np.linspace(0, 1, 200)[:, None]
                line = view.project(ends[0] + steps * (ends[1] - ends[0]))
                seen = _seen(image, line)
                for mask, style in ((seen, "-"), (np.logical_not(seen), ":")):
                    shown = np.where(mask[:, None], line[:, :2], np.nan)
                    axes.plot(
                        shown[:, 0],
                        shown[:, 1],
                        style,
                        color=_VOLUME,
                        linewidth=1.4 if style == "-" else 1.0,
                        alpha=1.0 if style == "-" else 0.6,
                    )


def _seen(image: Image, line: Array) -> npt.NDArray[np.bool_]:
    height, width = image.depth.shape
    u = np.clip(line[:, 0].astype(int), 0, width - 1)
    v = np.clip(line[:, 1].astype(int), 0, height - 1)
    return np.asarray(line[:, 2] < image.depth[v, u] + 2e-3)


def _draw_frame(axes: Axes, view: View) -> None:
    """The world's directions, 10 cm long, in the lower left corner."""
    depth = float(np.linalg.norm(view.eye)) or 1.0
    pixels = np.array([0.09 * view.width, 0.88 * view.height])
    ray = np.append((pixels - (view.width / 2, view.height / 2)) / view.focal_length, 1.0)
    origin = view.eye + view.rotation.T @ (ray * depth)
    for axis, (name, colour) in enumerate(
        zip("xyz", ("#d62728", "#2ca02c", "#1f77b4"), strict=True)
    ):
        tip = origin + 0.1 * np.eye(3)[axis]
        ends = view.project(np.vstack([origin, tip]))[:, :2]
        axes.annotate(
            "",
            ends[1],
            ends[0],
            arrowprops={"arrowstyle": "->", "color": colour, "linewidth": 2.0, "shrinkA": 0},
        )
        beyond = ends[0] + 1.25 * (ends[1] - ends[0])
        axes.text(
            float(beyond[0]),
            float(beyond[1]),
            name,
            color=colour,
            fontsize=11,
            ha="center",
            va="center",
        )
    axes.text(
        pixels[0],
        pixels[1] + 0.05 * view.height,
        "arrows: 10 cm",
        fontsize=9,
        ha="center",
        bbox=_PLATE,
    )
