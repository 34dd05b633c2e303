"""What is measured of a situation: all of its surface, or what one depth camera sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.situations.situation import Cloud, Situation
from placement_planner_ros.core.scene.flying_pixels import flying_pixels
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.types import Array
from placement_planner_ros.scenes.clouds import (
    CameraNoise,
    DepthCamera,
    camera_clouds,
    complete_cloud,
)

_DEVIATIONS = 0.001, 0.002
FLYING_SHARE = 0.02
DEPTH_STEP = 0.0025
"""m at 1 m: 1.6 mm at 0.8 m."""


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """Points (n, 3) in the world frame, and the sights they are from where a sensor is known."""

    points: Array
    sights: tuple[View, ...] = ()


def camera_of(situation: Situation) -> DepthCamera:
    """The one camera, which looks at the middle of V."""
    volume = situation.scene.volume
    middle = 0.5 * (volume.lower + volume.upper)
    return DepthCamera.looking_at("camera", situation.eye, middle)


def pixels(situation: Situation, rng: np.random.Generator) -> Array:
    """(n, 3) what the one camera sees: noise of 1 to 2 mm, 2 % of all pixels flying in front of
    what they see, as many of those on an edge between its sides, and steps of depth."""
    noise = CameraNoise(
        range_deviation=float(rng.uniform(*_DEVIATIONS)),
        flying_share=FLYING_SHARE,
        stray_share=FLYING_SHARE,
        depth_step=DEPTH_STEP,
    )
    cameras = [camera_of(situation)]
    return camera_clouds(situation.scene, rng, cameras=cameras, noise=noise)[0].world_points()


def observe(situation: Situation, cloud: Cloud, rng: np.random.Generator) -> Observation:
    """The complete cloud; or the camera's `pixels` without flying ones, as a node filters them."""
    if cloud == "complete":
        return Observation(complete_cloud(situation.scene, situation.spacing))
    origin = camera_of(situation).T_world_camera.translation
    seen = pixels(situation, rng)
    seen = seen[~flying_pixels(seen, origin)]
    return Observation(seen, (View(seen, origin),))
