"""One situation: what stands where, what is to be placed, and whether that can be done."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.primitives import Colour, ConvexPrimitive, box, standing_box
from placement_planner_ros.scenes.scenes import Scene

Cloud = Literal["complete", "camera"]
CLOUDS: tuple[Cloud, ...] = ("complete", "camera")
Support = Literal["vertices", "polygon"]
Unknown = Literal["free", "occupied", "occupied_below"]

Point = tuple[float, float]

WOOD: Colour = (0.80, 0.68, 0.50)
THING: Colour = (0.55, 0.60, 0.68)
DARK: Colour = (0.55, 0.33, 0.22)

SLAB = 0.006
"""m that V reaches above and below the surface that is meant."""


@dataclass(frozen=True, slots=True, eq=False)
class Situation:
    """What is given, and the true answer.

    Attributes:
        name: tells situations apart; `group` says what it is about.
        thing: the object, one of `ALL_OBJECTS`.
        scene: the solids, and V.
        why: what makes it possible or impossible, in words.
        witness: T_world_object of a pose that is right; None where there is none.
        robot_can: whether the robot can bring the object there.
        support: how s(x) is judged.
        eye: (3,) where the one camera is; it looks at the middle of V.
        seen: the true answer for what the one camera can see; that of the scene unless given.
        unseen: why the camera's answer differs from the scene's.
        unknown: what counts where the one camera has seen nothing.
        spacing: m between points of the complete cloud.
    """

    name: str
    group: str
    thing: str
    scene: Scene
    why: str
    witness: pin.SE3 | None = None
    robot_can: bool = True
    support: Support = "vertices"
    eye: tuple[float, float, float] = (0.20, 0.0, 0.90)
    seen: bool | None = None
    unseen: str = ""
    unknown: Unknown = "occupied_below"
    spacing: float = 0.005

    @property
    def pose_exists(self) -> bool:
        """Whether the object can stand there at all."""
        return self.witness is not None

    def possible(self, cloud: Cloud) -> bool:
        """The true answer."""
        if cloud == "camera" and self.seen is not None:
            return self.seen
        return self.pose_exists and self.robot_can


@dataclass(frozen=True, slots=True)
class Rest:
    """How an object stands.

    Attributes:
        up, front: directions in its frame that point upwards, and forwards where it is not turned.
        height: of its origin above what it stands on, metres.
    """

    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    front: tuple[float, float, float] = (1.0, 0.0, 0.0)
    height: float = 0.0


UPRIGHT = Rest()
"""Of things whose frame is on what they stand on."""
SMALL_BOX = Rest(height=0.0355)
"""The small box on its side of 94 × 21 mm."""
BOX_ON_EDGE = Rest((0.0, -1.0, 0.0), height=0.062)
"""The large box on its side of 144 × 36 mm."""
BOX_ON_END = Rest((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.072)
"""The large box on its side of 124 × 36 mm."""
BOX_LYING = Rest(height=0.018)
TRAY_UPSIDE_DOWN = Rest((0.0, 0.0, -1.0), height=0.030)


def place(rng: np.random.Generator) -> Point:
    """Somewhere on the table that both the hand and its way out reach easily."""
    side = 1.0 if rng.random() < 0.5 else -1.0
    return rng.uniform(0.36, 0.42), side * rng.uniform(0.08, 0.18)


def table(top: float = 0.0) -> ConvexPrimitive:
    """The bundled table, its top at that height."""
    return box("table", (0.139, -0.426, top - 0.04), (0.695, 0.474, top), WOOD)


def slab(centre: Point, half: Point, z: float, height: float = SLAB) -> TargetVolume:
    """V around a surface: half of its sides, and so much below and above the surface, metres."""
    low = np.array([centre[0] - half[0], centre[1] - half[1], z - height])
    return TargetVolume(low, np.array([centre[0] + half[0], centre[1] + half[1], z + height]))


def standing(at: Point, z: float = 0.0, rest: Rest = UPRIGHT, yaw: float = 0.0) -> pin.SE3:
    """T_world_object of what stands on the plane at `z`, its front turned by `yaw` (rad)."""
    up, front = np.array(rest.up), np.array(rest.front)
    own = np.column_stack([front, np.cross(up, front), up])
    cos, sin = np.cos(yaw), np.sin(yaw)
    world = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return pin.SE3(world @ own.T, np.array([*at, z + rest.height]))


def walls(
    name: str,
    centre: Point,
    inner: Point,
    height: float,
    thick: float = 0.010,
    bottom: float = 0.0,
    yaw: float = 0.0,
) -> tuple[ConvexPrimitive, ...]:
    """Four walls around a space of those inner sides: a bin whose floor is the table."""
    length, width = inner[0], inner[1]
    cos, sin = np.cos(yaw), np.sin(yaw)
    made = []
    for number, (x, y, along, across) in enumerate(
        (
            (0.5 * (length + thick), 0.0, thick, width),
            (-0.5 * (length + thick), 0.0, thick, width),
            (0.0, 0.5 * (width + thick), length + 2.0 * thick, thick),
            (0.0, -0.5 * (width + thick), length + 2.0 * thick, thick),
        )
    ):
        middle = (centre[0] + cos * x - sin * y, centre[1] + sin * x + cos * y)
        size = (along, across, height)
        made.append(standing_box(f"{name}/wall_{number}", size, middle, yaw, bottom, THING))
    return tuple(made)
