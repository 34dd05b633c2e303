"""Values shared by every stage: V, goals, paths, timed curves and placements.

Metres, radians, seconds. Arrays are float64, copied and made read-only at construction.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.boxes import disjoint_rectangles
from placement_planner_ros.core.errors import VolumeError

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]
"""Rows, numbers of things, labels."""
Index32 = npt.NDArray[np.int32]
"""The same, where there are many."""
Mask = npt.NDArray[np.bool_]

FULL_TURN = 2.0 * math.pi
"""rad."""
ROUNDING = 1e-9
"""m, rad, or their rates: far above what floating point loses, and nothing to any robot."""
SINGLE_ROUNDING = 1e-6
"""m, rad, cells, units of ξ, and parts of a whole: more than what single precision loses. Points as
near as this are one."""
MAX_BOXES = 64
"""Boxes that V is the union of, at most."""


def kernel_input(values: npt.ArrayLike) -> Array:
    """Contiguous writable float64, so that a kernel compiles once and not for read-only anew."""
    if type(values) is np.ndarray and values.dtype == np.float64:
        flags = values.flags
        if flags.c_contiguous and flags.writeable and flags.aligned:
            return values
    return np.require(values, np.float64, ["C", "W"])


def frozen_array(values: npt.ArrayLike, shape: tuple[int, ...] | None = None) -> Array:
    """Copy `values` to a read-only float64 array; -1 in `shape` matches any length.

    Raises:
        ValueError: the shape differs.
    """
    array = np.array(values, dtype=np.float64)
    if shape is not None and (
        array.ndim != len(shape)
        or any(s not in (-1, d) for s, d in zip(shape, array.shape, strict=True))
    ):
        raise ValueError(f"expected shape {shape}, got {array.shape}")
    array.setflags(write=False)
    return array


def frozen_integers(values: npt.ArrayLike) -> Index:
    """Copy `values` to a read-only int64 array."""
    array = np.array(values, dtype=np.int64)
    array.setflags(write=False)
    return array


Slope = tuple[float, float]
"""∂z/∂x and ∂z/∂y of a plane."""
LEVEL: Slope = (0.0, 0.0)


class Contact(NamedTuple):
    """What an object rests with, and on which plane."""

    feature: int
    """Of the object, mostly a placement face (`contacts.ContactClass`)."""
    height: float
    """z of the plane at x = y = 0, metres."""
    slope: Slope = LEVEL


def upright(slope: npt.ArrayLike) -> Array:
    """(..., 3, 3) R_n: the least turn that takes z to the normals of planes of slope (..., 2).

    The identity where a plane is level.
    """
    x, y = np.moveaxis(np.asarray(slope, dtype=np.float64), -1, 0)
    nz = 1.0 / np.sqrt(1.0 + x * x + y * y)
    nx, ny = -x * nz, -y * nz
    share = 1.0 / (1.0 + nz)
    turn = np.empty((*x.shape, 3, 3))
    turn[..., 0, 0], turn[..., 1, 1] = 1.0 - nx * nx * share, 1.0 - ny * ny * share
    turn[..., 0, 1] = turn[..., 1, 0] = -nx * ny * share
    turn[..., 0, 2], turn[..., 1, 2], turn[..., 2, 2] = nx, ny, nz
    turn[..., 2, 0], turn[..., 2, 1] = -nx, -ny
    return turn


def steepness(slope: npt.ArrayLike) -> float:
    """rad between a plane of slope (2,) and the level."""
    return float(np.arctan(np.hypot(*np.asarray(slope, dtype=np.float64))))


class Verdict(enum.IntEnum):
    """What a sample's first failed check was, in the paper's order; what the tip's pose alone
    decides (hand, release, approach) is asked before the inverse kinematics."""

    OUTSIDE_VOLUME = 0
    """Reference contact point outside V, or centre of mass horizontally."""
    UNSTABLE = 1
    """s(x) = 0: a vertex of v(f) has no support."""
    COLLIDING = 2
    """c_f(x) = 0: the object meets obstacles at rest or on its way down."""
    BREAKS_RULE = 3
    """The object is not turned as asked, or a required term is too low."""
    NOT_BETTER = 4
    """ξ(x) ≤ ξ_best."""
    NO_IK = 5
    """No arm configuration within the joint limits reaches the pose."""
    ARM_COLLIDING = 6
    """Arm, hand or held object collide in every configuration found."""
    NO_RELEASE = 7
    """The fingers cannot open without meeting something."""
    NO_APPROACH = 8
    """No certified straight approach ends in the pose."""
    NO_RETREAT = 9
    """No certified straight way leads the open hand away from the placed object."""
    FEASIBLE = 10
    """Every constraint holds: a goal."""


def _volume_numbers(given: npt.ArrayLike) -> Array:
    """What is given of V as an array.

    Raises:
        VolumeError: it is none of numbers, or not as many in each row.
    """
    try:
        return np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise VolumeError("`volume`", given, "give six finite numbers for each box") from None


@dataclass(frozen=True, slots=True, eq=False, init=False)
class TargetVolume:
    """V, the union of axis-aligned boxes in the planning frame; mostly of one.

    A placement lies in it where its reference contact point does, and its centre of mass
    horizontally: how high that is follows from the surface and the object. Each may lie in any of
    the boxes.

    Attributes:
        boxes: (k, 2, 3) lower and upper corners as they were given, metres.
        lower, upper: (3,) corners of the box around V, metres.
    """

    boxes: Array
    lower: Array
    upper: Array

    def __init__(self, lower: npt.ArrayLike, upper: npt.ArrayLike) -> None:
        """Of one box or several.

        Args:
            lower, upper: (3,) corners of a box, or (k, 3) of up to `MAX_BOXES`, metres.

        Raises:
            VolumeError: a corner is no three finite numbers, a box is empty, or they are too many.
        """
        corners = [np.atleast_2d(_volume_numbers(corner)) for corner in (lower, upper)]
        shape = corners[0].shape
        if shape != corners[1].shape or len(shape) != 2 or shape[1] != 3 or not shape[0]:
            given = [corner.tolist() for corner in corners]
            raise VolumeError("`volume`", given, "give six finite numbers for each box")
        boxes = np.stack(corners, axis=1)
        if len(boxes) > MAX_BOXES:
            raise VolumeError("`volume`", f"{len(boxes)} boxes", f"give {MAX_BOXES} at most")
        for number, box in enumerate(boxes):
            which = f" (box {number + 1} of {len(boxes)})" if len(boxes) > 1 else ""
            if not np.isfinite(box).all():
                raise VolumeError("`volume`", box.tolist(), f"give six finite numbers{which}")
            if not (box[1] > box[0]).all():
                raise VolumeError(
                    "`volume`",
                    box.ravel().tolist(),
                    f"give the minimum corner first; every side must be longer than zero{which}",
                )
        object.__setattr__(self, "boxes", frozen_array(boxes))
        object.__setattr__(self, "lower", frozen_array(boxes[:, 0].min(axis=0)))
        object.__setattr__(self, "upper", frozen_array(boxes[:, 1].max(axis=0)))

    @classmethod
    def of_numbers(cls, numbers: npt.ArrayLike) -> TargetVolume:
        """Of (6 k,) numbers, the minimum and the maximum corner of each box one after the other.

        Raises:
            VolumeError: not six per box; otherwise as for the corners.
        """
        flat = _volume_numbers(numbers)
        if flat.ndim != 1 or len(flat) == 0 or len(flat) % 6:
            raise VolumeError("`volume`", flat.tolist(), "give six numbers for each box")
        corners = flat.reshape(-1, 2, 3)
        return cls(corners[:, 0], corners[:, 1])

    def contains(self, points: Array) -> Mask:
        """Which of the (n, 3) points lie in V."""
        points = np.asarray(points)[..., None, :]
        inside = (points >= self.boxes[:, 0]) & (points <= self.boxes[:, 1])
        return np.asarray(inside.all(axis=-1).any(axis=-1))

    def section(self, z: float) -> Array:
        """(k, 2, 2) lower and upper corners of disjoint rectangles: V at a height."""
        cut = self.boxes[(self.boxes[:, 0, 2] <= z) & (z <= self.boxes[:, 1, 2])]
        return disjoint_rectangles(cut[:, :, :2])

    def same(self, other: TargetVolume) -> bool:
        """Whether both were given as the same boxes."""
        return np.array_equal(self.boxes, other.boxes)


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A timed joint curve: quintic between its points, as a joint_trajectory_controller plays it.

    Attributes:
        joints: names, in column order.
        times: (n,) seconds, strictly increasing from 0.
        positions, velocities, accelerations: (n, len(joints)).
    """

    joints: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array
    accelerations: Array

    def __post_init__(self) -> None:
        shape = (len(self.times), len(self.joints))
        object.__setattr__(self, "times", frozen_array(self.times, (-1,)))
        for name in ("positions", "velocities", "accelerations"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), shape))

    @property
    def duration(self) -> float:
        """Seconds from the first to the last point."""
        return float(self.times[-1])

    def turned(self, by: Array) -> Trajectory:
        """The same motion from elsewhere: each joint's positions changed by `by` (joints,)."""
        return replace(self, positions=self.positions + by)


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """A goal (q, a): a verified placement x = O(q) with its straight approach and retreat.

    Attributes:
        arm: name of the arm a.
        grasp: index into the arm's grasps.
        face: index into the body's placement faces, or beyond these of other features.
        T_world_object: x, the placement pose.
        contact_height: z of the contact plane, where it slopes at x = y = 0.
        approach: (k, dof) joint waypoints from the raised pre-placement to contact; the last is q.
        objective: ξ(x).
        retreat: (m, dof) joint waypoints of the open hand from q away from the object; None where
            release or retreat could not be certified.
        slope: of the contact plane; the object stands along its normal.
        opening: (3,) direction of the way back from contact to the raised pre-placement.
    """

    arm: str
    grasp: int
    face: int
    T_world_object: pin.SE3
    contact_height: float
    approach: Array
    objective: float
    retreat: Array | None = None
    slope: Slope = LEVEL
    opening: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "approach", frozen_array(self.approach, (-1, -1)))
        if self.retreat is not None:
            object.__setattr__(self, "retreat", frozen_array(self.retreat, (-1, -1)))

    @property
    def contact(self) -> Contact:
        """What the object rests with, and on which plane."""
        return Contact(self.face, self.contact_height, self.slope)

    @property
    def q(self) -> Array:
        """(dof,) configuration at contact."""
        return np.asarray(self.approach[-1])

    @property
    def q_raised(self) -> Array:
        """(dof,) configuration at the raised pre-placement, where transit ends."""
        return np.asarray(self.approach[0])


@dataclass(frozen=True, slots=True, eq=False)
class Resting:
    """How an object is held by its surroundings.

    Attributes:
        contact: the contact class, as in the parameter `contacts`.
        on: what it leans on, in words; '' where it stands.
        points: (k, 3) where it touches, in the world, metres.
        normals: (k, 3) unit, there into the object.
        friction: (k,) coefficients that count there; 0 where it is held by a push alone.
        wall: (4, 3) corners of what it leans on, one after the other; (0, 3) where it stands.
    """

    contact: str
    on: str
    points: Array
    normals: Array
    friction: Array
    wall: Array


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A published solution: where, how, with which arm and grasp, along which motion.

    Attributes:
        goal: the placement reached.
        trajectory: from q_0 through transit and approach to contact.
        approach_start: seconds into the trajectory at which the approach begins.
        search_time: seconds from the start of the run until it was found.
        samples: goal samples tried until then.
        retreat: from there on, the hand open and the object left behind; None without.
        terms: names and values of what it is judged by and what is required of it.
        unseen: share of the way, of arm and object, through space in and around V that no sensor
            looked at; None where no sensor's place is known.
        gap: ξ that can be had at most beyond this; None where that is not known.
        resting: how the object rests there.
    """

    goal: Goal
    trajectory: Trajectory
    approach_start: float
    search_time: float
    samples: int
    retreat: Trajectory | None = None
    terms: tuple[tuple[str, float], ...] = ()
    unseen: float | None = None
    gap: float | None = None
    resting: Resting | None = None

    def turned(self, by: Array) -> Placement:
        """The same with whole turns `by` (dof,), rad, more in continuous joints."""
        if not by.any():
            return self
        goal, retreat = self.goal, self.retreat
        away = None if goal.retreat is None else goal.retreat + by
        return replace(
            self,
            goal=replace(goal, approach=goal.approach + by, retreat=away),
            trajectory=self.trajectory.turned(by),
            retreat=None if retreat is None else retreat.turned(by),
        )

    @property
    def arm(self) -> str:
        """Name of the arm a that puts the object down."""
        return self.goal.arm

    @property
    def grasp(self) -> int:
        """Index into that arm's grasps."""
        return self.goal.grasp

    @property
    def T_world_object(self) -> pin.SE3:
        """The placement pose x."""
        return self.goal.T_world_object

    @property
    def objective(self) -> float:
        """ξ(x)."""
        return self.goal.objective
