"""Situations in which things lean on walls, or could not, with their true answer."""

from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin
import trimesh
from helpers.footholds import bare_problem

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.contacts.lean import LeanContact
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.scene.flying_pixels import flying_pixels
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.clouds import (
    CameraNoise,
    DepthCamera,
    camera_clouds,
    complete_cloud,
)
from placement_planner_ros.scenes.primitives import ConvexPrimitive, box, standing_box
from placement_planner_ros.scenes.scenes import Scene

VOLUME = TargetVolume([0.3, -0.25, -0.03], [0.75, 0.25, 0.3])
GREY = (0.7, 0.7, 0.7)
EYE = np.array([-0.2, -0.25, 0.65])


@dataclass
class LeanSituation:
    """A thing, and what there is to lean it on."""

    name: str
    possible: bool
    thing: trimesh.Trimesh
    parts: tuple[ConvexPrimitive, ...]
    settings: dict = field(default_factory=dict)

    @property
    def scene(self):
        return Scene(self.name, VOLUME, self.parts)

    @property
    def body(self):
        return Body.from_mesh(self.thing.vertices, self.thing.faces)

    def environment(self, cloud, rng):
        """Of the complete cloud, or of what one noisy camera sees."""
        bounds = VOLUME.lower - 0.5, VOLUME.upper + 0.5
        if cloud == "complete":
            return Environment.from_points(complete_cloud(self.scene), VOLUME, bounds=bounds)
        middle = 0.5 * (VOLUME.lower + VOLUME.upper)
        camera = DepthCamera.looking_at("camera", EYE, middle)
        noise = CameraNoise(range_deviation=0.001)
        seen = camera_clouds(self.scene, rng, cameras=[camera], noise=noise)[0].world_points()
        seen = seen[~flying_pixels(seen, EYE)]
        return Environment.from_points(seen, VOLUME, bounds=bounds, sights=(View(seen, EYE),))

    def contact(self, environment):
        """The contact class."""
        settings = replace(PlannerSettings(contacts=("lean",)), **self.settings)
        return LeanContact(
            bare_problem(self.body, environment), settings.footing, settings.collision
        )


def leaning_poses(contact, rng, most, tries=300):
    """(T, feature) of random draws that stay and are free, `most` at most."""
    found = []
    if not contact.regions:
        return found
    for _ in range(tries):
        region = contact.regions[rng.integers(len(contact.regions))]
        open_ = [k for k in range(len(contact.frames)) if contact.ranges(k, region)]
        feature = np.array([rng.choice(open_)])
        T = contact.poses(feature, region.sample(rng)[None], np.zeros(1), None)
        if contact.stable(T, feature, region.slope)[0] and contact.held(T, feature)[0]:
            heights = np.array([region.z])
            if contact.free(T, feature, heights, 0.05, region.slope)[0]:
                found.append((T[0], int(feature[0])))
        if len(found) == most:
            break
    return found


def _floor(end=0.9, top=0.0):
    return box("floor", (-0.1, -0.7, -0.1), (end, 0.7, top), GREY)


def _off_level(degrees):
    """The floor, turned about a level line askew to all walls."""
    turn = pin.exp3(np.deg2rad(degrees) * np.array([0.8, 0.6, 0.0]))
    return ConvexPrimitive("floor", _floor().vertices @ turn.T, GREY)


def _wall(x=0.7, height=0.5, low=-0.6, high=0.6):
    return box("wall", (x, low, -0.1), (x + 0.1, high, height), GREY)


def _askew(degrees, height=0.4):
    """A wall that leans back by so much."""
    upright = box("wall", (0.7, -0.6, 0.0), (0.8, 0.6, height), GREY).vertices
    back = np.outer(upright[:, 2] * np.tan(np.deg2rad(degrees)), (1.0, 0.0, 0.0))
    return ConvexPrimitive("wall", upright + back, GREY)


def _l_shape(rng):
    """Two boards that meet at a right angle."""
    height, depth, thick, wide = rng.uniform(0.18, 0.22), rng.uniform(0.05, 0.07), 0.015, 0.12
    back = trimesh.creation.box((thick, wide, height))
    foot = trimesh.creation.box((depth, wide, thick))
    foot.apply_translation((0.5 * (thick + depth), 0.0, 0.5 * (thick - height)))
    return trimesh.util.concatenate([back, foot])


def situations(seed):
    """All of them, of that seed's sizes."""
    rng = np.random.default_rng(seed)
    draw = rng.uniform

    def plate(thick, wide, high):
        return trimesh.creation.box((draw(*thick), draw(*wide), draw(*high)))

    def book():
        return plate((0.02, 0.04), (0.13, 0.17), (0.19, 0.24))

    def tray():
        return plate((0.015, 0.025), (0.26, 0.32), (0.18, 0.22))

    bottle = trimesh.creation.cylinder(draw(0.03, 0.04), draw(0.18, 0.24), sections=48)
    plain = (_floor(), _wall())
    cabinet = box("cabinet", (0.62, -0.2, 0.0), (0.85, 0.2, 0.4), GREY)
    turned = standing_box("box", (0.12, 0.3, 0.25), (0.65, 0.0), 0.5, 0.0, GREY)
    side = box("side", (0.3, 0.25, 0.0), (0.7, 0.35, 0.5), GREY)
    roof = box("roof", (0.2, -0.6, 0.09), (0.8, 0.6, 0.13), GREY)
    posts = [box("post", (0.7, y, 0.0), (0.72, y + 0.02, 0.5), GREY) for y in (-0.45, 0.43)]
    return [
        LeanSituation("book", True, book(), plain),
        LeanSituation("tray", True, tray(), plain),
        LeanSituation("rough tray", True, tray(), (_off_level(1.0), _wall()), {"friction": 0.7}),
        LeanSituation(
            "cabinet side",
            True,
            plate((0.01, 0.015), (0.2, 0.25), (0.28, 0.33)),
            (_floor(), cabinet),
        ),
        LeanSituation("turned box", True, book(), (_floor(), turned)),
        LeanSituation("leaning wall", True, book(), (_floor(), _askew(draw(6.0, 10.0)))),
        LeanSituation("overhang", True, book(), (_floor(), _askew(-draw(4.0, 7.0)))),
        LeanSituation("corner", True, book(), (*plain, side)),
        LeanSituation(
            "box of cereals", True, plate((0.05, 0.07), (0.15, 0.19), (0.25, 0.3)), plain
        ),
        LeanSituation("L", True, _l_shape(rng), plain),
        LeanSituation("slippery", False, tray(), plain, {"friction": draw(0.05, 0.09)}),
        LeanSituation("much asked", False, tray(), plain, {"stability_margin": draw(0.3, 0.5)}),
        LeanSituation("bottle", False, bottle, plain),
        LeanSituation(
            "plate", False, trimesh.creation.cylinder(0.1, draw(0.006, 0.01), sections=48), plain
        ),
        LeanSituation("low wall", False, tray(), (_floor(), _wall(height=draw(0.03, 0.06)))),
        LeanSituation("no wall", False, book(), (_floor(0.6, 0.01),)),
        LeanSituation("wall beyond a gap", False, book(), (_floor(0.5), _wall())),
        LeanSituation("steep", False, book(), (_floor(), _askew(draw(24.0, 30.0)))),
        LeanSituation("posts", False, tray(), (_floor(), *posts)),
        LeanSituation("headroom", False, book(), (_floor(), _wall(height=0.13), roof)),
    ]


def disturbed(T, center, rng):
    """A pose (4, 4) up to 2 mm and 1 degree away, turned about the centre of mass."""
    axis, way = rng.normal(size=(2, 3))
    turn = pin.exp3(np.deg2rad(rng.uniform(0.0, 1.0)) * axis / np.linalg.norm(axis))
    off = pin.SE3(turn, rng.uniform(0.0, 0.002) * way / np.linalg.norm(way))
    middle = pin.SE3(np.eye(3), T[:3, :3] @ center + T[:3, 3])
    return middle * off * middle.inverse() * pin.SE3(T)
