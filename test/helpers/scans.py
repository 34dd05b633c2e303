"""Things as a scanner would have them: closed meshes of many triangles, with noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh

from placement_planner_ros.scenes.objects import OBJECT_NAMES, object_by_name


def finer(mesh: trimesh.Trimesh, triangles: int) -> trimesh.Trimesh:
    """The same surface in at least so many triangles, without a crack, the longest edges cut."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    while len(faces) < triangles:
        sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, edge = np.unique(sides, axis=0, return_inverse=True)
        length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
        # Cutting an edge adds a triangle on each side of it.
        most = max(1, min(len(edges) // 3, (triangles - len(faces) + 1) // 2))
        cut = np.zeros(len(edges), bool)
        cut[np.argsort(-length, kind="stable")[:most]] = True
        middle = np.full(len(edges), -1)
        middle[cut] = len(vertices) + np.arange(cut.sum())
        vertices = np.vstack([vertices, vertices[edges[cut]].mean(axis=1)])
        faces = _split(faces, middle[edge.reshape(-1, 3)])
    return trimesh.Trimesh(vertices, faces, process=False)


def _split(faces, middle):
    """Triangles (t, 3) cut at the middles (t, 3) of their edges, -1 where an edge is not cut."""
    made = []
    for turn in range(3):
        # turned so that the pattern of cut edges is one of four
        f, m = np.roll(faces, -turn, axis=1), np.roll(middle, -turn, axis=1)
        a, b, c = f.T
        ab, bc, ca = m.T
        one = (ab >= 0) & (bc < 0) & (ca < 0)
        two = (ab >= 0) & (bc >= 0) & (ca < 0)
        made += [np.column_stack(x)[one] for x in ((a, ab, c), (ab, b, c))]
        made += [np.column_stack(x)[two] for x in ((ab, b, bc), (a, ab, bc), (a, bc, c))]
    a, b, c = faces.T
    ab, bc, ca = middle.T
    none, all_ = (middle < 0).all(axis=1), (middle >= 0).all(axis=1)
    made.append(faces[none])
    made += [
        np.column_stack(x)[all_] for x in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    ]
    return np.concatenate(made)


def noisy(mesh: trimesh.Trimesh, noise: float, rng: np.random.Generator) -> trimesh.Trimesh:
    """Each vertex moved along its normal, by a normal distribution of that deviation, metres."""
    welded = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    along = rng.normal(scale=noise, size=(len(welded.vertices), 1))
    return trimesh.Trimesh(
        welded.vertices + along * welded.vertex_normals, welded.faces, process=False
    )


def revolved(profile: list[tuple[float, float]], sections: int = 48) -> trimesh.Trimesh:
    """A closed profile of (radius, height), bottom to top, turned about z."""
    return trimesh.creation.revolve(np.array(profile), sections=sections)


def bulging(size: tuple[float, float, float], bulge: float, count: int = 24) -> trimesh.Trimesh:
    """A box whose sides bulge outwards, most in their middles, metres."""
    mesh = finer(trimesh.creation.box(size), 12 * count * count // 4)
    half = np.array(size) / 2.0
    at = np.asarray(mesh.vertices) / half
    moved = np.zeros_like(at)
    for axis in range(3):
        a, b = (k for k in range(3) if k != axis)
        dome = (1.0 - at[:, a] ** 2) * (1.0 - at[:, b] ** 2)
        on = np.abs(np.abs(at[:, axis]) - 1.0) < 1e-6
        moved[:, axis] += np.where(on, np.sign(at[:, axis]) * bulge * dome, 0.0)
    return trimesh.Trimesh(mesh.vertices + moved, mesh.faces, process=False)


def tube(path: np.ndarray, radii: np.ndarray, sides: int, flat: float = 1.0) -> trimesh.Trimesh:
    """Rings of radii (n,) about points (n, 3) in the plane y = 0, closed by their middles."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    angle = 2.0 * np.pi * np.arange(sides) / sides
    across = np.cross([0.0, 1.0, 0.0], along)
    rings = (
        path[:, None]
        + radii[:, None, None] * np.cos(angle)[None, :, None] * across[:, None]
        + flat * radii[:, None, None] * np.sin(angle)[None, :, None] * np.array([0.0, 1.0, 0.0])
    )
    count = len(path)
    vertices = np.vstack([rings.reshape(-1, 3), path[:1], path[-1:]])
    k, j = np.meshgrid(np.arange(count - 1), np.arange(sides), indexing="ij")
    a, b = k * sides + j, k * sides + (j + 1) % sides
    quads = np.stack([a, b, a + sides, b, b + sides, a + sides], axis=-1).reshape(-1, 3)
    ring = np.arange(sides)
    first = np.column_stack([np.full(sides, count * sides), np.roll(ring, -1), ring])
    last = np.column_stack([np.full(sides, count * sides + 1), ring, np.roll(ring, -1)])
    last[:, 1:] += (count - 1) * sides
    mesh = trimesh.Trimesh(vertices, np.vstack([quads, first, last]), process=False)
    if mesh.volume < 0.0:
        mesh.invert()
    return mesh


def banana() -> trimesh.Trimesh:
    """180 mm long, bent, thinner at both ends."""
    angle = np.linspace(-0.75, 0.75, 40)
    path = np.column_stack([0.13 * np.sin(angle), np.zeros(40), 0.13 * (1.0 - np.cos(angle))])
    radii = 0.018 * np.sqrt(np.maximum(1.0 - (angle / 0.78) ** 4, 0.05))
    return tube(path, radii, 24)


def mug() -> trimesh.Trimesh:
    """80 mm wide, 95 mm high, with a handle that reaches into its wall."""
    cup = revolved(
        [
            (0, 0),
            (0.036, 0),
            (0.040, 0.01),
            (0.040, 0.095),
            (0.036, 0.095),
            (0.036, 0.006),
            (0, 0.006),
        ]
    )
    angle = np.linspace(-1.45, 1.45, 24)
    path = np.column_stack(
        [0.037 + 0.030 * np.cos(angle), np.zeros(24), 0.048 + 0.030 * np.sin(angle)]
    )
    return trimesh.util.concatenate([cup, tube(path, np.full(24, 0.006), 16)])


def drill() -> trimesh.Trimesh:
    """A motor with a chuck on a slanting handle on a battery, parts that overlap."""
    motor = trimesh.creation.cylinder(radius=0.030, height=0.15, sections=40)
    chuck = trimesh.creation.cylinder(radius=0.018, height=0.06, sections=40)
    for part, x in ((motor, 0.0), (chuck, 0.10)):
        part.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
        part.apply_translation([x, 0, 0])
    handle = trimesh.creation.box((0.040, 0.036, 0.13))
    handle.apply_transform(trimesh.transformations.rotation_matrix(0.2, [0, 1, 0]))
    handle.apply_translation([-0.045, 0, -0.075])
    battery = trimesh.creation.box((0.11, 0.075, 0.05))
    battery.apply_translation([-0.045, 0, -0.155])
    return trimesh.util.concatenate([motor, chuck, handle, battery])


def bottle() -> trimesh.Trimesh:
    """68 mm wide, 227 mm high, full."""
    return revolved(
        [
            (0, 0),
            (0.030, 0),
            (0.034, 0.006),
            (0.034, 0.14),
            (0.014, 0.19),
            (0.014, 0.227),
            (0, 0.227),
        ]
    )


def bowl() -> trimesh.Trimesh:
    """160 mm wide, 60 mm high, 4 mm thick, with a foot."""
    outer = [(0.030, 0.0), (0.034, 0.004), (0.060, 0.022), (0.080, 0.060)]
    inner = [(0.076, 0.060), (0.057, 0.026), (0.032, 0.008), (0.0, 0.008)]
    return revolved([(0.0, 0.0), *outer, *inner])


def _bundled(name: str) -> Callable[[], trimesh.Trimesh]:
    def make() -> trimesh.Trimesh:
        thing = object_by_name(name)
        return trimesh.Trimesh(thing.vertices, thing.triangles, process=False)

    return make


def _cylinder(sides: int, radius: float, height: float) -> Callable[[], trimesh.Trimesh]:
    return lambda: trimesh.creation.cylinder(radius=radius, height=height, sections=sides)


SHAPES: dict[str, Callable[[], trimesh.Trimesh]] = {
    **{name: _bundled(name) for name in OBJECT_NAMES},
    "box": lambda: trimesh.creation.box((0.10, 0.07, 0.045)),
    "flat box": lambda: trimesh.creation.box((0.16, 0.11, 0.025)),
    "tall box": lambda: trimesh.creation.box((0.05, 0.06, 0.19)),
    "bulging box": lambda: bulging((0.12, 0.08, 0.06), 0.003),
    "cylinder of 12": _cylinder(12, 0.034, 0.102),
    "cylinder of 32": _cylinder(32, 0.034, 0.102),
    "cone": lambda: trimesh.creation.cone(radius=0.04, height=0.12, sections=48),
    "ball": lambda: trimesh.creation.icosphere(subdivisions=3, radius=0.035),
    "bottle": bottle,
    "hollow bowl": bowl,
    "mug": mug,
    "banana": banana,
    "drill": drill,
}
"""Shapes without noise, by name."""
