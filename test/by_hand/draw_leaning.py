"""Draw the situations of leaning, each with what is found there, or why nothing is.

python test/by_hand draw_leaning --output docs/images
"""

from __future__ import annotations

import argparse
import itertools
import textwrap
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pinocchio as pin
from helpers.leaning import GREY, LeanSituation, leaning_poses, situations

mpl.use("Agg")
import matplotlib.pyplot as plt
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

IN_A_ROW = 5
ELEVATION, AZIMUTH = np.deg2rad([18.0, -150.0])
TOWARDS_EYE = np.array(
    [np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)]
)
GREEN, BLUE, RED = (0.45, 0.75, 0.45), (0.1, 0.25, 0.7), (0.8, 0.15, 0.1)
CONE_M = 0.06
"""m, length of cones and pushes."""
FRONT, SHOWN = 0.3, np.array([0.5, 0.6, 0.4])
"""m: where what is shown begins along x, and its size; across, the thing is in its middle."""


def solid(axes, vertices, triangles, colour, alpha):
    """Add triangles, shaded by how they face."""
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    light = 0.7 + 0.3 * np.abs(normals @ np.array([0.4, 0.3, 0.87]))
    faces = np.column_stack([np.outer(light, colour), np.full(len(light), alpha)])
    far = -corners.mean(axis=1) @ TOWARDS_EYE
    order = np.argsort(-far)
    shown = Poly3DCollection(corners[order], facecolors=faces[order], edgecolors="none")
    axes.add_collection3d(shown)


def draw(axes, situation: LeanSituation):
    """One situation, with a pose that was found."""
    rng = np.random.default_rng(1)
    contact = situation.contact(situation.environment("complete", rng))
    found = leaning_poses(contact, rng, most=1, tries=200)
    vertices, triangles = situation.thing.vertices, situation.thing.faces
    if found:
        T, feature = found[0]
        placed = vertices @ T[:3, :3].T + T[:3, 3]
    else:
        placed = vertices - vertices.mean(axis=0) + [0.42, 0.0, np.ptp(vertices[:, 2]) / 2]
    low = np.array([FRONT, placed[:, 1].mean() - 0.5 * SHOWN[1], 0.0])
    high = low + SHOWN
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(tuple(SHOWN), zoom=1.45)
    for part in situation.parts:
        solid(axes, np.clip(part.vertices, low, high), part.triangles, GREY, 0.35)
    if found:
        solid(axes, placed, triangles, GREEN, 0.9)
        resting = contact.resting(pin.SE3(T), feature)
        friction = situation.settings.get("friction", 0.3)
        for point, normal in zip(resting.points, resting.normals, strict=True):
            draw_force(axes, point, normal, friction)
    else:
        solid(axes, placed, triangles, RED, 0.25)
    missing = contact.missing()
    words = "" if found else missing.words if missing else "no pose is free on all of its way"
    axes.set_title(situation.name, fontsize=10)
    axes.text2D(
        0.5, -0.02, textwrap.fill(words, 40), ha="center", fontsize=7, transform=axes.transAxes
    )


def draw_force(axes, point, normal, friction):
    """A cone on the surface, a push of the wall."""
    if normal[2] > 0.9:
        turns = np.linspace(0.0, 2.0 * np.pi, 17)
        rim = point + CONE_M * np.column_stack(
            [friction * np.cos(turns), friction * np.sin(turns), np.ones(len(turns))]
        )
        triangles = [np.array([point, a, b]) for a, b in itertools.pairwise(rim)]
        axes.add_collection3d(Poly3DCollection(triangles, facecolors=(*BLUE, 0.3)))
    else:
        axes.quiver(*point, *(CONE_M * normal), color=RED, linewidth=1.2)


def main() -> None:
    """Write one picture a row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("docs/images"))
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    shown = situations(asked.seed)
    for row, first in enumerate(range(0, len(shown), IN_A_ROW), 1):
        figure = plt.figure(figsize=(13.0, 3.2))
        for column, situation in enumerate(shown[first : first + IN_A_ROW], 1):
            axes = figure.add_subplot(1, IN_A_ROW, column, projection="3d")
            axes.view_init(*np.rad2deg([ELEVATION, AZIMUTH]))
            axes.set_axis_off()
            axes.computed_zorder = False  # what comes later is in front
            draw(axes, situation)
        figure.subplots_adjust(0.0, 0.06, 1.0, 0.93, wspace=0.0)
        figure.savefig(asked.output / f"leaning_{row}.png", dpi=80)
        plt.close(figure)


if __name__ == "__main__":
    main()
