"""The page's scene: what stands where, drawn with viser."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import viser

from placement_planner_ros.core.types import Array
from placement_planner_ros.view import colours
from placement_planner_ros.view.robot_shapes import LinkShape
from placement_planner_ros.view.world import Surface

LAYERS = {
    "robot": "robot",
    "cloud": "cloud",
    "occupancy": "obstacle set",
    "volume": "target volume V",
    "regions": "regions",
    "earlier": "other placements found",
    "standing": "objects placed before",
    "path": "way of the object",
}
"""What can be shown and hidden, by its place in the scene, with its name for people."""
FIELD_OF_VIEW = np.deg2rad(40.0)
"""From the lower to the upper edge of the picture, rad."""
_POINT, _STANDING_POINT = 0.004, 0.007
"""m, the size of a point of a cloud, and of those on an object that was placed before."""
_EDGES = [(0, 1), (1, 3), (3, 2), (2, 0), (4, 5), (5, 7), (7, 6), (6, 4), (0, 4), (1, 5), (2, 6),
          (3, 7)]  # fmt: skip


class Stage:
    """Draws into a server's scene; each part is drawn anew only when it is another."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._scene = server.scene
        self._scene.set_up_direction("+z")
        # Shadows hide what is in them, and take most of the time where there is no graphics card.
        self._scene.configure_default_lights(cast_shadow=False)
        self._links: dict[str, Any] = {}
        self._ghosts: dict[str, Any] = {}
        self._held: list[Any] = []
        self._parts: dict[str, Any] = {}
        self._layers = {name: self._scene.add_frame(f"/{name}", show_axes=False) for name in LAYERS}
        self._ghost = self._scene.add_frame("/start", show_axes=False, visible=False)

    def show(self, layer: str, visible: bool) -> None:
        """Show or hide one of `LAYERS`."""
        self._layers[layer].visible = visible

    def draw_robot(self, shapes: Sequence[LinkShape]) -> None:
        """Another robot: one mesh for each link, and one for its ghost."""
        for handle in [*self._links.values(), *self._ghosts.values()]:
            handle.remove()
        self._links, self._ghosts = {}, {}
        for shape in shapes:
            mesh: dict[str, Any] = {
                "vertices": shape.vertices.astype(np.float32),
                "faces": shape.triangles.astype(np.uint32),
                "flat_shading": True,
                "side": "double",
            }
            self._links[shape.link] = self._scene.add_mesh_simple(
                f"/robot/{shape.link}", color=shape.colour, **mesh
            )
            self._ghosts[shape.link] = self._scene.add_mesh_simple(
                f"/start/{shape.link}",
                color=colours.START,
                opacity=0.25,
                cast_shadow=False,
                **mesh,
            )

    def place_robot(self, poses: Mapping[str, pin.SE3]) -> None:
        """Move the links to T_world_link."""
        with self._server.atomic():
            _move_handles(self._links, poses)

    def place_ghost(self, poses: Mapping[str, pin.SE3] | None) -> None:
        """Show the start of these links at T_world_link, or hide all of it."""
        self._ghost.visible = poses is not None
        if poses is not None:
            with self._server.atomic():
                _move_handles(self._ghosts, poses)
                for name, handle in self._ghosts.items():
                    handle.visible = name in poses

    def show_label(self, shown: bool) -> None:
        """Show or hide the name above the placement."""
        if "label" in self._parts:
            self._parts["label"].visible = shown

    def draw_held(self, surface: Surface | None, poses: Sequence[pin.SE3], ghost: bool) -> None:
        """The object in the hand, once for each hand that could hold it.

        Args:
            ghost: draw the first as it was at the start, grey.
        """
        shown = [] if surface is None else list(poses)
        for k, handle in enumerate(self._held):
            handle.visible = k < len(shown)
        for k, T in enumerate(shown):
            assert surface is not None
            grey = ghost and k == 0
            colour = colours.START if grey else colours.HELD
            opacity = 0.35 if grey else (None if ghost or len(shown) == 1 else 0.6)
            made = _add_mesh(self._scene, f"/held/{k}", surface, T, colour, opacity)
            self._held[k : k + 1] = [made]

    def move_held(self, number: int, T_world_object: pin.SE3, held: bool = True) -> None:
        """Move one of the objects in hands; hide it where it is held no more."""
        if number < len(self._held):
            _move_handles({"": self._held[number]}, {"": T_world_object})
            self._held[number].visible = held

    def draw_placement(self, surface: Surface | None, T: pin.SE3 | None, text: str) -> None:
        """The object where it will stand, with its name above."""
        self._clear("placed", "label")
        if surface is None or T is None:
            return
        self._parts["placed"] = _add_mesh(self._scene, "/placed", surface, T, colours.PLACED, None)
        top = surface[0] @ T.rotation.T + T.translation
        above = (*top.mean(axis=0)[:2], top[:, 2].max() + 0.04)
        self._parts["label"] = self._scene.add_label(
            "/label", text, position=above, anchor="bottom-center"
        )

    def draw_earlier(self, surface: Surface | None, poses: Sequence[pin.SE3]) -> None:
        """Where the object would have stood by the run's other solutions."""
        self._clear("earlier")
        if surface is None or not poses:
            return
        vertices, triangles = surface
        self._parts["earlier"] = self._scene.add_batched_meshes_simple(
            "/earlier/all",
            vertices=vertices.astype(np.float32),
            faces=triangles.astype(np.uint32),
            batched_wxyzs=np.array([_wxyz_of(T) for T in poses]),
            batched_positions=np.array([T.translation for T in poses]),
            batched_colors=np.array(colours.EARLIER, np.uint8),
            opacity=0.2,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def draw_path(self, path: Array | None) -> None:
        """The way of the object's origin (n, 3)."""
        self._clear("path")
        if path is not None and len(path) > 1:
            self._parts["path"] = self._scene.add_line_segments(
                "/path/line",
                np.stack([path[:-1], path[1:]], axis=1).astype(np.float32),
                colours.PATH,
                thickness=0.006,
            )

    def draw_volume(self, boxes: Array) -> None:
        """The edges of V's boxes (k, 2, 3)."""
        self._clear("volume")
        lines = [
            [[box[(i >> axis) & 1, axis] for axis in range(3)] for i in edge]
            for box in boxes
            for edge in _EDGES
        ]
        if lines:
            self._parts["volume"] = self._scene.add_line_segments(
                "/volume/edges",
                np.array(lines, np.float32),
                colours.VOLUME,
                thickness=0.004,
            )

    def draw_regions(self, rectangles: Array) -> None:
        """The regions' rectangles (n, 4, 3)."""
        self._clear("regions")
        if len(rectangles) == 0:
            return
        halves = np.array([[0, 1, 2], [0, 2, 3]])
        faces = (4 * np.arange(len(rectangles))[:, None, None] + halves).reshape(-1, 3)
        above = rectangles.reshape(-1, 3) + np.array([0.0, 0.0, 0.002])
        self._parts["regions"] = self._scene.add_mesh_simple(
            "/regions/all",
            above.astype(np.float32),
            faces.astype(np.uint32),
            color=colours.REGION,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def draw_cloud(self, topic: str, points: Array) -> None:
        """A cloud's points (n, 3) in the planning frame; the one before goes."""
        self._draw_points(
            f"/cloud/{_plain_name(topic)}", points, colours.by_height(points[:, 2]), _POINT
        )

    def draw_occupancy(self, points: Array, cell_size: float) -> None:
        """The middles of the obstacle set's cells (n, 3)."""
        colour = np.tile(np.array(colours.OBSTACLES, np.uint8), (len(points), 1))
        self._draw_points("/occupancy/cells", points, colour, 0.7 * cell_size)

    def draw_standing(self, points: Array) -> None:
        """Points (n, 3) on what earlier runs have placed."""
        colour = np.tile(np.array(colours.STANDING, np.uint8), (len(points), 1))
        self._draw_points("/standing/points", points, colour, _STANDING_POINT)

    def _draw_points(
        self, name: str, points: Array, colour: npt.NDArray[np.uint8], size: float
    ) -> None:
        """As one node, whose place is in the middle: coordinates go with half precision."""
        if len(points) == 0:  # browsers complain of a cloud without points
            self._clear(name)
            return
        middle = points.mean(axis=0)
        self._parts[name] = self._scene.add_point_cloud(
            name,
            (points - middle).astype(np.float32),
            colour,
            point_size=size,
            point_shape="rounded",
            point_shading="flat",
            position=tuple(middle),
        )

    def look_from(self, eye: Array, at: Array) -> None:
        """From where whoever opens the page looks at first, and who has it open looks now."""
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.fov = eye, at, FIELD_OF_VIEW
        for client in self._server.get_clients().values():
            client.camera.position, client.camera.look_at = eye, at
            client.camera.fov = FIELD_OF_VIEW

    def _clear(self, *names: str) -> None:
        for name in names:
            handle = self._parts.pop(name, None)
            if handle is not None:
                handle.remove()


def _add_mesh(
    scene: Any, name: str, surface: Surface, T: pin.SE3, colour: colours.Rgb, opacity: float | None
) -> Any:
    vertices, triangles = surface
    return scene.add_mesh_simple(
        name,
        vertices.astype(np.float32),
        triangles.astype(np.uint32),
        color=colour,
        opacity=opacity,
        flat_shading=True,
        side="double",
        position=tuple(T.translation),
        wxyz=_wxyz_of(T),
    )


def _wxyz_of(T: pin.SE3) -> Array:
    """(4,) the rotation as a quaternion, real part first."""
    return np.roll(pin.SE3ToXYZQUAT(T)[3:], 1)


def _move_handles(handles: Mapping[str, Any], poses: Mapping[str, pin.SE3]) -> None:
    for name, handle in handles.items():
        T = poses.get(name)
        if T is not None:
            handle.position, handle.wxyz = T.translation, _wxyz_of(T)


def _plain_name(topic: str) -> str:
    return "".join(c if c.isalnum() else "_" for c in topic)
