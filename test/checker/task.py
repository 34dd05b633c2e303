"""What was asked, what was published, and what is forgiven."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Triangles = npt.NDArray[np.int64]

WORLD = "environment"
"""Link name of everything that does not move."""


class Solid(Protocol):
    """A convex solid: the hull of its vertices (n, 3), world frame."""

    @property
    def name(self) -> str: ...
    @property
    def vertices(self) -> Array: ...


class Curve(Protocol):
    """A trajectory: times (n,), positions, velocities, accelerations (n, len(joints))."""

    joints: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array
    accelerations: Array


@dataclass(frozen=True)
class Asked:
    """What was asked of the placement beside that it is possible, by the node's parameters.

    Attributes:
        up, front: (3,) directions in the object's frame; None for none.
        up_tolerance, front_direction, front_tolerance: rad.
        near_pose: (7,) x y z qx qy qz qw; None for none.
        weights: of the terms whose sum the objective is; empty for "do not check".
        at_least: of the terms that are required.
    """

    up: Array | None = None
    up_tolerance: float = 0.17
    front: Array | None = None
    front_direction: float = 0.0
    front_tolerance: float = 0.26
    near_pose: Array | None = None
    weights: Mapping[str, float] = field(default_factory=dict)
    at_least: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Task:
    """What was asked.

    Attributes:
        solids: the environment's true convex solids.
        volume_lower, volume_upper: (3,) corners of V, or (k, 3) of the boxes whose union it is.
        object_vertices, object_triangles, center_of_mass: the object in its own frame: each of its
            connected components the solid that its triangles close, or a sheet.
        urdf, srdf: texts; `package://<name>/` leads to package_dirs[name], a file's name without
            a folder to begin from to package_dirs[""], the URDF's own.
        q_start: joint name -> value of every joint that mimics no other.
        objective: `maximize_clearance`, `minimize_clearance`, or anything else for "do not check".
        measured: (2, n, 3) lower and upper corners of the boxes that hold what was measured; None
            for "do not check the margin".
        beyond: how far outside V things count for the clearance, metres.
        support: `vertices`, or `polygon`: by what an object stands.
        support_margin: with `polygon`, from its centre of mass to the end of what carries it, m.
        up: (3,) direction of the object that is to stay near the vertical on the way; None for any.
        max_tilt: its angle from the vertical at most, rad.
        max_acceleration: of the centre of mass on the way, m/s².
        keep_out: (k, 2, 3) corners of boxes that keep the margin from all that moves.
        friction, stability_margin: of an object that may lean; None and 0 where it may not.
        asked: rules and wishes, see `Asked`.
    """

    solids: Sequence[Solid]
    volume_lower: Array
    volume_upper: Array
    object_vertices: Array
    object_triangles: npt.NDArray[np.int64]
    center_of_mass: Array
    urdf: str = ""
    srdf: str = ""
    package_dirs: Mapping[str, str | Path] = field(default_factory=dict)
    q_start: Mapping[str, float] = field(default_factory=dict)
    objective: str = "none"
    measured: Array | None = None
    beyond: float = 0.0
    support: str = "vertices"
    support_margin: float = 0.01
    up: Array | None = None
    max_tilt: float = np.pi
    max_acceleration: float = np.inf
    keep_out: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    friction: float | None = None
    stability_margin: float = 0.0
    asked: Asked = field(default_factory=lambda: Asked())

    @property
    def volume(self) -> Array:
        """(k, 2, 3) corners of V's boxes."""
        corners = np.atleast_2d(self.volume_lower), np.atleast_2d(self.volume_upper)
        return np.stack(corners, axis=1)

    @classmethod
    def of(cls, scene: Any, thing: Any, **more: Any) -> Task:
        """Of a `Scene` and anything that has vertices, triangles and a center_of_mass."""
        corners = scene.volume.boxes[:, 0], scene.volume.boxes[:, 1]
        return cls(
            scene.parts, *corners, thing.vertices, thing.triangles, thing.center_of_mass, **more
        )


@dataclass(frozen=True)
class Solution:
    """What was published, with the grasp it refers to."""

    trajectory: Curve
    approach_start: float
    placement_pose: Array  # (4, 4) T_world_object
    objective: float
    tip_frame: str
    T_tip_object: Array  # (4, 4)
    touch_links: Sequence[str]
    retreat: Curve | None = None
    gripper_open: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, placement: Any, arm: Any) -> Solution:
        """Of a `Placement` and the `Arm` it was found for."""
        return cls(
            placement.trajectory,
            placement.approach_start,
            placement.T_world_object.homogeneous,
            placement.objective,
            arm.tip_frame,
            arm.grasps[placement.goal.grasp].homogeneous,
            arm.touch_links,
            placement.retreat,
            dict(zip(arm.gripper_joints, arm.gripper_open, strict=True)),
        )


@dataclass(frozen=True)
class Tolerances:
    """Metres, radians, seconds.

    Attributes:
        margin: to be kept from what was measured.
        contact: the contact tolerance of the planner.
        step: no point of the robot moves further than this between two checked states.
        acceleration_limit: per joint of the trajectory, or one for all.
        limit: relative excess over a limit that is forgiven.
        penetration: numerical slack of the collision library.
        flatness: vertices this close to the lowest, along the normal of the surface, are those it
            stands on.
        slope: rad, what is steeper carries nothing.
        lean: rad that the object may be turned from the normal of the surface it stands on.
        carried: by which the margin of `support_margin` may be undercut.
        objective: between the published ξ and those recomputed from the true solids.
        layer: height of the planner's cells, which ξ may be coarse by (`clearance_bounds`).
        pushing: how much deeper a finger may get into the object while it opens.
        touching: way of the hand, at the longest, on which links that touch the object when the
            hand is open may touch it still; those that have come off before must not meet it again.
        tilt: rad, what floating point may lose.
        parted: distance of all links from the object at the end of the retreat, at least.
    """

    margin: float = 0.003
    contact: float = 0.003
    step: float = 0.002
    acceleration_limit: float | Mapping[str, float] = np.inf
    limit: float = 1e-3
    penetration: float = 2e-5
    flatness: float = 1e-3
    slope: float = 0.27
    lean: float = 0.008
    carried: float = 5e-4
    height: float = 5e-4
    edge: float = 1e-5
    position: float = 5e-4
    angle: float = np.deg2rad(0.2)
    objective: float = 0.01
    layer: float = 0.01
    pushing: float = 2e-4
    touching: float = 3.05e-3
    parted: float = 1e-3
    tilt: float = 1e-9


def world_vertices(task: Task, T_world_object: Array) -> Array:
    """The object's vertices (n, 3) at a pose (4, 4)."""
    vertices = np.asarray(task.object_vertices)
    return np.asarray(vertices @ T_world_object[:3, :3].T + T_world_object[:3, 3])
