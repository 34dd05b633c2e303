"""One situation: what stands where, what is to be placed, and whether that can be done."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

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
Limits = tuple[float, float]
"""Between which a size is drawn, m."""

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
class ObjectStance:
    """How an object stands.

    Attributes:
        up, front: directions in its frame that point upwards, and forwards where it is not turned.
        height: of its origin above what it stands on, metres.
    """

    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    front: tuple[float, float, float] = (1.0, 0.0, 0.0)
    height: float = 0.0


UPRIGHT = ObjectStance()
"""Of things whose frame is on what they stand on."""
SMALL_BOX = ObjectStance(height=0.0355)
"""The small box on its side of 94 × 21 mm."""
BOX_ON_EDGE = ObjectStance((0.0, -1.0, 0.0), height=0.062)
"""The large box on its side of 144 × 36 mm."""
BOX_ON_END = ObjectStance((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.072)
"""The large box on its side of 124 × 36 mm."""
BOX_LYING = ObjectStance(height=0.018)
TRAY_UPSIDE_DOWN = ObjectStance((0.0, 0.0, -1.0), height=0.030)


@dataclass(frozen=True, slots=True)
class SituationKind:
    """What is the same whatever sizes are drawn.

    Attributes:
        name, group, thing, support: as in `Situation`.
        why: with fields such as {width:.0f} for sizes, which are told in mm.
        stance: of a pose that is right; None where there is none.
    """

    name: str
    group: str
    thing: str
    why: str
    stance: ObjectStance | None = None
    support: Support = "vertices"

    def sized(self, **sizes: float) -> SituationKind:
        """The sizes, in metres, told in `why`."""
        in_mm = {name: 1e3 * size for name, size in sizes.items()}
        return replace(self, why=self.why.format(**in_mm))

    def drawn(
        self,
        volume: TargetVolume,
        solids: Iterable[ConvexPrimitive],
        at: Point,
        z: float = 0.0,
        yaw: float = 0.0,
        **given: Any,
    ) -> Situation:
        """The situation: V, what stands on the bundled table, and where the object would stand.

        Args:
            at, z, yaw: see `standing_pose`; not used without a stance.
            given: further fields of `Situation`.
        """
        witness = None if self.stance is None else standing_pose(at, z, self.stance, yaw)
        return self.in_scene(volume, (table_top(), *solids), witness, **given)

    def in_scene(
        self,
        volume: TargetVolume,
        solids: tuple[ConvexPrimitive, ...],
        witness: pin.SE3 | None,
        **given: Any,
    ) -> Situation:
        """The situation among all its solids."""
        scene = Scene(self.name, volume, solids)
        words = self.name, self.group, self.thing, scene, self.why
        return Situation(*words, witness, support=self.support, **given)


Draw = Callable[[np.random.Generator], Situation]
"""A situation with sizes of its own."""


def some_place(rng: np.random.Generator) -> Point:
    """Somewhere on the table that both the hand and its way out reach easily."""
    side = 1.0 if rng.random() < 0.5 else -1.0
    return rng.uniform(0.36, 0.42), side * rng.uniform(0.08, 0.18)


def table_top(top: float = 0.0) -> ConvexPrimitive:
    """The bundled table, its top at that height."""
    return box("table", (0.139, -0.426, top - 0.04), (0.695, 0.474, top), WOOD)


def slab_around(centre: Point, half: Point, z: float, height: float = SLAB) -> TargetVolume:
    """V around a surface: half of its sides, and so much below and above the surface, metres."""
    low = np.array([centre[0] - half[0], centre[1] - half[1], z - height])
    return TargetVolume(low, np.array([centre[0] + half[0], centre[1] + half[1], z + height]))


def standing_pose(
    at: Point, z: float = 0.0, stance: ObjectStance = UPRIGHT, yaw: float = 0.0
) -> pin.SE3:
    """T_world_object of what stands on the plane at `z`, its front turned by `yaw` (rad)."""
    up, front = np.array(stance.up), np.array(stance.front)
    own = np.column_stack([front, np.cross(up, front), up])
    cos, sin = np.cos(yaw), np.sin(yaw)
    world = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return pin.SE3(world @ own.T, np.array([*at, z + stance.height]))


def four_walls(
    name: str, centre: Point, inner: Point, height: float, thick: float = 0.010, bottom: float = 0.0
) -> tuple[ConvexPrimitive, ...]:
    """Four walls around a space of those inner sides: a bin whose floor is the table."""
    (x, y), (length, width) = centre, inner
    sides = [((x + s * (length + thick), y), (thick, width)) for s in (0.5, -0.5)]
    sides += [((x, y + s * (width + thick)), (length + 2.0 * thick, thick)) for s in (0.5, -0.5)]
    return tuple(
        standing_box(f"{name}/wall_{k}", (*size, height), middle, 0.0, bottom, THING)
        for k, (middle, size) in enumerate(sides)
    )
