"""Bodies in motion: a robot with drives, a scene, and things that can be moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import pinocchio as pin

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.demo.physics.model import Bodies, SimulatedThing, WeldedObject
from placement_planner_ros.scenes.primitives import ConvexPrimitive


@dataclass(frozen=True, slots=True)
class PhysicsContact:
    """Two that press on each other.

    Attributes:
        first, second: a link, a part of the scene, or a thing, by name.
        steepness: rad between the direction in which they press and the vertical.
    """

    first: str
    second: str
    steepness: float


class PhysicsWorld:
    """All bodies, and where they are.

    Args:
        scene: solids that never move.
        q: (nq,) where the robot stands at first, at rest.
        held: of the things, the one in a hand; it is where the hand is.
    """

    def __init__(
        self,
        robot: Robot,
        scene: Sequence[ConvexPrimitive],
        things: Sequence[SimulatedThing],
        q: Array,
        held: WeldedObject,
    ) -> None:
        bodies = Bodies()
        bodies.add_robot(robot)
        bodies.add_scene(scene)
        for thing in things:
            bodies.add_thing(thing)
        bodies.hold(robot, held)
        self._model = bodies.compiled(things)
        self._data = mujoco.MjData(self._model)
        joints = [self._model.joint(name) for name in robot.joint_names]
        self._q = np.array([joint.qposadr[0] for joint in joints])
        self._v = np.array([joint.dofadr[0] for joint in joints])
        owners = {f"solid {number}": owner for number, owner in enumerate(bodies.owners)}
        self._owners = [owners[self._model.geom(i).name] for i in range(self._model.ngeom)]
        self._data.qpos[self._q] = q
        mujoco.mj_forward(self._model, self._data)

    @property
    def q(self) -> Array:
        """(nq,) of the robot."""
        return np.array(self._data.qpos[self._q])

    @property
    def v(self) -> Array:
        """(nv,) of the robot."""
        return np.array(self._data.qvel[self._v])

    def place_of(self, thing: str) -> pin.SE3:
        """T_world_thing."""
        body = self._data.body(thing)
        return pin.SE3(body.xmat.reshape(3, 3).copy(), body.xpos.copy())

    def let_go(self) -> None:
        """Nothing fixes the held thing in the hand any more."""
        self._data.eq_active[:] = 0

    def touches(self) -> list[PhysicsContact]:
        """What presses on what."""
        found = []
        for i in range(self._data.ncon):
            contact = self._data.contact[i]
            first, second = (self._owners[k] for k in contact.geom)
            upward = abs(float(contact.frame[2]))
            found.append(PhysicsContact(first, second, float(np.arccos(min(upward, 1.0)))))
        return found

    def step(self, accelerations: Array) -> None:
        """Go on by `TIME_STEP`, with forces of the drives that would give the robot's joints these
        accelerations (nv,), were nothing in their way."""
        wanted, forces = np.zeros(self._model.nv), np.zeros(self._model.nv)
        wanted[self._v] = accelerations
        mujoco.mj_mulM(self._model, self._data, forces, wanted)
        self._data.qfrc_applied[self._v] = (forces + self._data.qfrc_bias)[self._v]
        mujoco.mj_step(self._model, self._data)
