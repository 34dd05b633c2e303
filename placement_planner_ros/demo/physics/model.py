"""Robot, scene and things as a mujoco model.

Masses are made up, where descriptions have none: links and things are solid, of one density each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import coal
import mujoco
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.scenes.primitives import ConvexPrimitive

TIME_STEP = 0.001
"""Seconds."""
FRICTION = 0.6
"""Sliding friction of all contacts: between smooth plastic on lacquer and rubber on wood."""
_LINK_DENSITY, _THING_DENSITY = 1500.0, 300.0
"""kg/m³. An arm of the bundled robot weighs 9 kg so."""
_DRIVE_INERTIA = {"hinge": 0.05, "slide": 0.5}
"""kg m² and kg that a geared drive adds to its joint, so that light fingers hold, too."""
_HELD_STIFFLY = (0.004, 1.0)
"""Of what fixes a thing in the hand: seconds in which it undoes a displacement, and damping."""
_SLIP_LESS = 10.0
"""Stiffness of friction over that of contacts, so that what stands creeps by 0.01 mm/s at most and
not by ten times that."""
BASE = "base"
"""Body of all links that no joint moves."""


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedThing:
    """Something that stands or is held, and can be knocked over.

    Attributes:
        name: another one for each.
        parts: vertices (n, 3) of convex solids whose union it is, metres, in its frame.
        center_of_mass: (3,) in its frame.
        T_world_thing: where it is at first.
    """

    name: str
    parts: tuple[Array, ...]
    center_of_mass: Array
    T_world_thing: pin.SE3


@dataclass(frozen=True, slots=True, eq=False)
class WeldedObject:
    """A thing fixed in a hand.

    Attributes:
        thing: its name.
        link: of the hand.
        T_link_thing: the grasp.
    """

    thing: str
    link: str
    T_link_thing: pin.SE3


@dataclass(slots=True)
class Bodies:
    """A model in the making.

    Attributes:
        owners: whose each of the model's solids is: a link, a part of the scene or a thing.
    """

    spec: Any = field(default_factory=mujoco.MjSpec)
    owners: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.spec.option.timestep = TIME_STEP
        self.spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        self.spec.option.impratio = _SLIP_LESS

    def add_robot(self, robot: Robot) -> None:
        """Links as the solids that collisions are checked with.

        Raises:
            ValueError: one of these is not convex, or a joint has not one position.
        """
        model = robot.model
        if model.nq != model.njoints - 1 or model.nv != model.nq:
            raise ValueError(f"{robot.name}: physics needs joints of one position each")
        bodies = [self.spec.worldbody.add_body(name=BASE)]
        for number in range(1, model.njoints):
            parent = bodies[model.parents[number]]
            body = parent.add_body(
                name=model.names[number], **_pose_fields(model.jointPlacements[number])
            )
            kind, axis = _joint_axis(model, number)
            body.add_joint(
                name=model.names[number],
                type=getattr(mujoco.mjtJoint, f"mjJNT_{kind.upper()}"),
                axis=axis,
                armature=_DRIVE_INERTIA[kind],
            )
            bodies.append(body)
        for solid, link in zip(robot.geometry.geometryObjects, robot.geometry_links, strict=True):
            if not isinstance(solid.geometry, coal.ConvexBase):
                raise ValueError(f"{robot.name}: physics needs convex solids; {solid.name} is none")
            vertices = np.array(solid.geometry.points())
            pose = _pose_fields(solid.placement)
            self._add_solid(bodies[solid.parentJoint], vertices, link, _LINK_DENSITY, pose)
        self._let_pass(robot)

    def add_scene(self, parts: Sequence[ConvexPrimitive]) -> None:
        """Solids that never move."""
        for part in parts:
            self._add_solid(self.spec.worldbody, part.vertices, part.thing, _THING_DENSITY)

    def add_thing(self, thing: SimulatedThing) -> None:
        """A thing that can move."""
        body = self.spec.worldbody.add_body(name=thing.name, **_pose_fields(thing.T_world_thing))
        body.add_freejoint()
        for vertices in thing.parts:
            self._add_solid(body, vertices, thing.name, _THING_DENSITY)

    def hold(self, robot: Robot, held: WeldedObject) -> None:
        """Fix a thing in the hand; the only equality constraint."""
        frame = robot.model.frames[robot.frame_id(held.link)]
        pose = _pose_fields(frame.placement * held.T_link_thing)
        name = robot.model.names[frame.parentJoint] if frame.parentJoint else BASE
        weld = self.spec.add_equality(
            type=mujoco.mjtEq.mjEQ_WELD,
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            name1=name,
            name2=held.thing,
            solref=_HELD_STIFFLY,
        )
        weld.data[:11] = [0.0, 0.0, 0.0, *pose["pos"], *pose["quat"], 1.0]

    def compiled(self, things: Sequence[SimulatedThing]) -> Any:
        """The model, with the centres of mass of things where they are said to be."""
        model = self.spec.compile()
        for thing in things:
            model.body(thing.name).ipos[:] = thing.center_of_mass
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def _add_solid(
        self,
        body: Any,
        vertices: Array,
        owner: str,
        density: float,
        pose: dict[str, list[float]] | None = None,
    ) -> None:
        name = f"solid {len(self.owners)}"
        self.spec.add_mesh(
            name=name,
            uservert=np.ravel(vertices).tolist(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
        )
        body.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            density=density,
            friction=[FRICTION, 0.005, 0.0001],
            **(pose or {}),
        )
        self.owners.append(owner)

    def _let_pass(self, robot: Robot) -> None:
        """No contacts between bodies of which no links are checked against each other."""
        solids = robot.geometry.geometryObjects
        checked = {
            frozenset({solids[pair.first].parentJoint, solids[pair.second].parentJoint})
            for pair in robot.geometry.collisionPairs
        }
        names = [BASE, *robot.model.names[1:]]
        for i, first in enumerate(names):
            for j, second in enumerate(names[:i]):
                if frozenset({i, j}) not in checked:
                    self.spec.add_exclude(bodyname1=first, bodyname2=second)


def _joint_axis(model: pin.Model, number: int) -> tuple[str, npt.NDArray[np.float64]]:
    """Whether the joint turns or slides, and its axis in its own frame."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    column = np.asarray(
        pin.getJointJacobian(model, data, number, pin.ReferenceFrame.LOCAL)[
            :, model.joints[number].idx_v
        ]
    )
    return ("slide", column[:3]) if np.linalg.norm(column[:3]) > 0.5 else ("hinge", column[3:])


def _pose_fields(T: pin.SE3) -> dict[str, list[float]]:
    x, y, z, w = pin.Quaternion(T.rotation).normalized().coeffs()
    return {"pos": T.translation.tolist(), "quat": [float(w), float(x), float(y), float(z)]}
