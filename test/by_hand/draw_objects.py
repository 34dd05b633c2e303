"""Draw every object of `settle_objects.py`: its cover over its mesh, and it on each of its rests,
v(f) in red beneath it.

python test/by_hand draw_objects --output docs/images
"""

from __future__ import annotations

import argparse
import colorsys
from pathlib import Path

import numpy as np
from by_hand.settle_objects import Thing, things

from benchmarks.evaluation.plots import new_figure, png
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.placement_face import PlacementFace
from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.pictures.rendering import Mesh, Viewpoint, render

_SIZE = (210, 180)
_COLUMNS, _ROWS = 8, 8
_GREEN, _AMBER = (0.35, 0.70, 0.40), (0.90, 0.68, 0.30)
_RED, _GREY = (0.85, 0.10, 0.10), (0.90, 0.90, 0.90)
_ALPHA = 0.72


def sheet(named: dict[str, Thing]) -> bytes:
    """A picture with a row for each object, its rests side by side."""
    figure = new_figure(1.5 * _COLUMNS, 1.6 * len(named), constrained=False)
    axes = figure.subplots(len(named), _COLUMNS, squeeze=False)
    figure.subplots_adjust(left=0.0, right=1.0, bottom=0.0, top=0.96, wspace=0.0, hspace=0.28)
    for row, (name, thing) in zip(axes, named.items(), strict=True):
        body = Body.from_mesh(
            thing.mesh.vertices,
            thing.mesh.faces,
            thing.center,
            settings=BodySettings(allow_rolling=True),
        )
        faces = sorted(body.faces, key=lambda face: face.rolls)
        rolling = sum(face.rolls for face in faces)
        for cell in row:
            cell.set_axis_off()
        row[0].imshow(np.clip(_covered(body), 0.0, 1.0))
        words = f"{name}\n{len(thing.mesh.faces):,} triangles\n{_cover_words(body)}"
        row[0].set_title(words, fontsize=6, pad=1.0)
        for number, cell in enumerate(row[1:]):
            if number >= len(faces) - max(rolling - 2, 0):
                continue
            face = faces[number]
            cell.imshow(np.clip(_picture(body, face), 0.0, 1.0))
            title = f"rolls, {rolling} such" if face.rolls else f"{1e4 * face.area:.0f} cm²"
            cell.set_title(title, fontsize=6, pad=1.0)
    return png(figure)


def _cover_words(body: Body) -> str:
    """How many convex sets there are, and by how much those of a cover reach beyond the mesh."""
    if body.mesh is None:
        return f"{len(body.solids)} convex, exact"
    return f"{len(body.parts)} convex, + {1000 * body.mesh.cover.excess:.1f} mm"


def _covered(body: Body) -> np.ndarray:
    """The mesh in grey through its convex sets, each in a colour of its own."""
    view = Viewpoint.around(body.vertices, (-1.0, 0.6), _SIZE)
    meshes = [Mesh(body.vertices, body.triangles, _GREY)]
    for number, part in enumerate(body.parts):
        colour = colorsys.hsv_to_rgb(0.618 * number % 1.0, 0.75, 0.9)
        middle = part.vertices.mean(axis=0)
        over = middle + 1.01 * (part.vertices - middle)  # in front of the mesh where it is flush
        meshes.append(Mesh(over, part.triangles, colour, 0.5))
    return render(view, meshes).colours


def _picture(body: Body, face: PlacementFace) -> np.ndarray:
    T = face.T_face_object
    center = T.act(body.center_of_mass) * [1.0, 1.0, 0.0]
    vertices = body.vertices @ T.rotation.T + T.translation - center
    patch = face.vertices @ T.rotation.T + T.translation - center
    size = float(np.ptp(vertices, axis=0).max())
    angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    disc = 0.75 * size * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(48)])
    view = Viewpoint.around(np.vstack([vertices, 0.8 * disc]), (-1.0, 0.35), _SIZE)
    meshes = [
        Mesh(disc - [0.0, 0.0, 0.004 * size], _fan(len(disc)), _GREY),
        Mesh(patch - [0.0, 0.0, 0.001 * size], _fan(len(patch)), _RED),
        Mesh(vertices, body.triangles, _AMBER if face.rolls else _GREEN, _ALPHA),
    ]
    return render(view, meshes).colours


def _fan(count: int) -> np.ndarray:
    at = np.arange(1, count - 1)
    return np.column_stack([np.zeros_like(at), at, at + 1])


def main() -> None:
    """Write objects_1.png and so on."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("docs/images"))
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    made = list(things().items())
    for number, first in enumerate(range(0, len(made), _ROWS)):
        file = options.output / f"objects_{number + 1}.png"
        file.write_bytes(sheet(dict(made[first : first + _ROWS])))


if __name__ == "__main__":
    main()
