"""The page's scene: what stands where, drawn with viser."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
import viser

from placement_planner_ros.core.types import Array
from placement_planner_ros.view import colours
from placement_planner_ros.view.robot_shapes import Surface

LAYERS = {
    "robot": "robot, as it is checked for collisions",
    "placed": "green: where the object will stand",
    "held": "orange: the object now",
    "path": "orange line: its way",
    "contacts": "violet and red: the wall it leans on, and what holds it",
    "volume": "pink: target volume V",
    "regions": "blue: surfaces in V that can carry",
    "standing": "dark green: known, or placed by earlier runs",
    "cloud": "grey: clouds",
    "occupancy": "brown: what counts as obstacle",
}
"""What can be shown and hidden, by its place in the scene, with its colour and name for people."""
FIELD_OF_VIEW = np.deg2rad(40.0)
"""From the lower to the upper edge of the picture, rad."""
_POINT, _STANDING_POINT = 0.004, 0.007
"""m, the size of a point of a cloud, and of those on an object that was placed before."""


class PageStage:
    """Draws into a server's scene; each part is drawn anew only when it is another."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._scene = server.scene
        self._scene.set_up_direction("+z")
        # Shadows hide what is in them, and take most of the time where there is no graphics card.
        self._scene.configure_default_lights(cast_shadow=False)
        self._links: dict[str, Any] = {}
        self._held: list[Any] = []
        self._held_surface: Surface | None = None
        self._parts: dict[str, Any] = {}
        # one frame for each layer, which hides all that hangs on it
        self._layers = {name: self._scene.add_frame(f"/{name}", show_axes=False) for name in LAYERS}

    def show(self, layer: str, visible: bool) -> None:
        """Show or hide one of `LAYERS`."""
        self._layers[layer].visible = visible

    def draw_robot(self, shapes: Mapping[str, Surface]) -> None:
        """Another robot: one mesh for each link, by its name."""
        for handle in self._links.values():
            handle.remove()
        self._links = {
            link: self._mesh(f"robot/{link}", surface, colours.LINK)
            for link, surface in shapes.items()
        }

    def place_robot(self, poses: Mapping[str, pin.SE3]) -> None:
        """Move the links to T_world_link."""
        with self._server.atomic():
            for name, handle in self._links.items():
                if name in poses:
                    _place(handle, poses[name])

    def draw_held(self, surface: Surface | None, poses: Sequence[pin.SE3]) -> None:
        """The object in the hand, once for each hand that could hold it."""
        # another object: the copies of the one before go
        if surface is not self._held_surface:
            self._held_surface = surface
            for handle in self._held:
                handle.remove()
            self._held = []
        if surface is not None:
            # a copy for each hand, made when it is needed first
            for k in range(len(self._held), len(poses)):
                self._held.append(self._mesh(f"held/{k}", surface, colours.HELD))
        for k, handle in enumerate(self._held):
            handle.visible = k < len(poses)
            if k < len(poses):
                _place(handle, poses[k])

    def draw_placement(self, surface: Surface | None, T: pin.SE3 | None) -> None:
        """The object where it will stand."""
        self._clear("placed")
        if surface is None or T is None:
            return
        self._parts["placed"] = self._mesh("placed/object", surface, colours.PLACED)
        _place(self._parts["placed"], T)

    def draw_path(self, path: Array | None) -> None:
        """The way of the object's origin (n, 3)."""
        steps = np.zeros((0, 2, 3)) if path is None else np.stack([path[:-1], path[1:]], axis=1)
        self._draw_lines("path", steps, colours.HELD, 0.006)

    def draw_contacts(self, lines: Array, wall: Array) -> None:
        """Lines (n, 2, 3) from where the object leans towards what holds it there, and triangles
        (3 w, 3) of the wall."""
        self._draw_lines("contacts", lines, colours.CONTACT, 0.002)
        self._draw_triangles("contacts/wall", wall, colours.WALL)
        if len(wall):
            self._parts["contacts/wall"].opacity = 0.35  # what is behind it is seen

    def draw_volume(self, boxes: Array) -> None:
        """The edges of V's boxes (k, 2, 3)."""
        lines = [
            # corners that differ in one bit are the ends of an edge
            [[box[(i >> k) & 1, k] for k in range(3)] for i in (corner, corner | 1 << axis)]
            for box in boxes
            for corner in range(8)
            for axis in range(3)
            if not corner >> axis & 1
        ]
        self._draw_lines("volume", np.array(lines).reshape(-1, 2, 3), colours.VOLUME, 0.004)

    def _draw_lines(self, layer: str, lines: Array, colour: colours.Rgb, thickness: float) -> None:
        """Lines (n, 2, 3) instead of those that the layer had."""
        self._clear(layer)
        if len(lines):
            self._parts[layer] = self._scene.add_line_segments(
                f"/{layer}/lines", lines.astype(np.float32), colour, thickness=thickness
            )

    def draw_regions(self, corners: Array) -> None:
        """The regions' triangles (3 t, 3), a little above the surface."""
        self._draw_triangles("regions/all", corners + np.array([0.0, 0.0, 0.002]), colours.REGION)

    def _draw_triangles(self, name: str, corners: Array, colour: colours.Rgb) -> None:
        """Triangles (3 t, 3) instead of those before."""
        self._clear(name)
        if len(corners):
            surface = corners, np.arange(len(corners)).reshape(-1, 3)
            self._parts[name] = self._mesh(name, surface, colour)

    def draw_cloud(self, topic: str, points: Array) -> None:
        """A cloud's points (n, 3) in the planning frame; the one before goes."""
        self._draw_points(f"/cloud/{topic.replace('/', '_')}", points, colours.CLOUD, _POINT)

    def draw_occupancy(self, points: Array, cell_size: float) -> None:
        """The middles of the obstacle set's cells (n, 3)."""
        self._draw_points("/occupancy/cells", points, colours.OBSTACLES, 0.7 * cell_size)

    def draw_standing(self, points: Array) -> None:
        """Points (n, 3) on what earlier runs have placed."""
        self._draw_points("/standing/points", points, colours.STANDING, _STANDING_POINT)

    def _draw_points(self, name: str, points: Array, colour: colours.Rgb, size: float) -> None:
        """As one node, whose place is in the middle: coordinates go with half precision."""
        if len(points) == 0:  # browsers complain of a cloud without points
            self._clear(name)
            return
        # relative to the middle, half precision is exact to a millimetre
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
        # for those who come, and for those who look now
        camera = self._server.initial_camera
        camera.position, camera.look_at, camera.fov = eye, at, FIELD_OF_VIEW
        for client in self._server.get_clients().values():
            client.camera.position, client.camera.look_at = eye, at
            client.camera.fov = FIELD_OF_VIEW

    def _mesh(self, name: str, surface: Surface, colour: colours.Rgb) -> Any:
        vertices, triangles = surface
        return self._scene.add_mesh_simple(
            f"/{name}",
            vertices.astype(np.float32),
            triangles.astype(np.uint32),
            color=colour,
            flat_shading=True,
            side="double",
        )

    def _clear(self, *names: str) -> None:
        for name in names:
            handle = self._parts.pop(name, None)
            if handle is not None:
                handle.remove()


def _place(handle: Any, T: pin.SE3) -> None:
    """Move something to T_world_thing."""
    handle.position, handle.wxyz = T.translation, np.roll(pin.SE3ToXYZQUAT(T)[3:], 1)
