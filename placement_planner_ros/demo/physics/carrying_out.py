"""Carry out a placement: follow the trajectories, open the hand, draw back, and look.

The drives follow what a joint_trajectory_controller asks of them: at each moment the quintic
between two points of the trajectory. The thing is fixed in the hand until that is told to open.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.timing.quintic import evaluate_trajectory
from placement_planner_ros.core.types import Array, Trajectory
from placement_planner_ros.demo.physics.model import TIME_STEP, SimulatedThing, WeldedObject
from placement_planner_ros.demo.physics.world import PhysicsContact, PhysicsWorld
from placement_planner_ros.pictures.stage_set import Look
from placement_planner_ros.playback import CARRIED
from placement_planner_ros.scenes.primitives import ConvexPrimitive

_RESTING, _OPENING, _LOOKING = 0.3, 0.6, 1.5
"""Seconds for which the arm rests before the hand opens, in which that opens, and from the end of
the retreat until it is measured where things stand."""
_STEPS = 20
"""From one look to the next."""
_STIFFNESS, _DAMPING = 125.0**2, 2.0 * 125.0
"""1/s² and 1/s of the drives: critically damped at 20 Hz."""
_UPWARD = np.deg2rad(45.0)
"""What presses on a thing within this of the vertical may carry it; else it was struck."""
CARRY, DOWN, LET_GO, DRAW_BACK, STAND = *CARRIED, "release", "retreat", "stand"


@dataclass(slots=True, eq=False)
class CarryingOut:
    """One placement, carried out by going through `looks`.

    Attributes:
        arm: that holds the thing.
        T_tip_thing: the grasp.
        q_start: (nq,) where the robot stands at first, with the fingers closed on the thing.
        scene: solids that never move.
        thing: the held one; it is where the hand is.
        standing: what was put down before.
        trajectory: there.
        approach_start: seconds into it at which the way down begins.
        retreat: away from there with the hand open; None where there is none.
        arrived: T_world_thing at the end of `trajectory`, still held.
        struck: pairs of names that pressed on each other and should not have.
    """

    robot: Robot
    arm: Arm
    T_tip_thing: pin.SE3
    q_start: Array
    scene: Sequence[ConvexPrimitive]
    thing: SimulatedThing
    standing: Sequence[SimulatedThing]
    trajectory: Trajectory
    approach_start: float
    retreat: Trajectory | None
    arrived: pin.SE3 = field(init=False)
    struck: set[tuple[str, str]] = field(init=False, default_factory=set)

    @property
    def duration(self) -> float:
        """Seconds from the first look to the last."""
        retreat = self.retreat.duration if self.retreat else 0.0
        return self.trajectory.duration + _RESTING + _OPENING + retreat + _LOOKING

    def looks(self) -> Iterator[Look]:
        """Carry it out, with a look now and then; the last is at what has come of it."""
        T_world_tip = self.robot.link_pose(self.q_start, self.arm.tip_frame)
        thing = replace(self.thing, T_world_thing=T_world_tip * self.T_tip_thing)
        things = [*self.standing, thing]
        held = WeldedObject(thing.name, self.arm.tip_frame, self.T_tip_thing)
        world = PhysicsWorld(self.robot, self.scene, things, self.q_start, held)
        stage, steps = CARRY, 0

        def look() -> Look:
            places = {each.name: world.place_of(each.name) for each in things}
            return Look(stage, steps * TIME_STEP, world.q, places)

        yield look()
        for stage, asked in self._stages():
            if stage == LET_GO:
                self.arrived = world.place_of(thing.name)
                world.let_go()
            for q, v, a in zip(*asked, strict=True):
                world.step(a + _STIFFNESS * (q - world.q) + _DAMPING * (v - world.v))
                steps += 1
                if stage == CARRY and steps * TIME_STEP >= self.approach_start:
                    stage = DOWN
                self._judge(world.touches(), stage)
                if steps % _STEPS == 0:
                    yield look()
        yield look()

    def _stages(self) -> Iterator[tuple[str, _Asked]]:
        """What is asked of the joints in each stage."""
        carried = _asked_motion(self.robot, self.q_start, self.trajectory)
        yield CARRY, carried
        q = carried[0][-1]
        yield DOWN, _asked_motion(self.robot, q, self._hand(q, q, _RESTING))
        opened = self.robot.with_open_hand(q, self.arm)
        yield LET_GO, _asked_motion(self.robot, q, self._hand(q, opened, _OPENING))
        if self.retreat is not None:
            drawn = _asked_motion(self.robot, opened, self.retreat)
            yield DRAW_BACK, drawn
            opened = drawn[0][-1]
        yield STAND, _asked_motion(self.robot, opened, self._hand(opened, opened, _LOOKING))

    def _hand(self, first: Array, last: Array, seconds: float) -> Trajectory:
        """All joints from one configuration to another, at rest in both."""
        ends = np.stack([first, last])
        still = np.zeros_like(ends)
        return Trajectory(self.robot.joint_names, np.array([0.0, seconds]), ends, still, still)

    def _judge(self, touches: Sequence[PhysicsContact], stage: str) -> None:
        """Note what presses on what that should not."""
        links, held = set(self.robot.geometry_links), self.thing.name
        is_held = stage in (CARRY, DOWN)
        for touch in touches:
            pair = {touch.first, touch.second}
            if held in pair:
                (other,) = pair - {held}
                if other in self.arm.touch_links:
                    continue
                carries = stage == DOWN and touch.steepness < _UPWARD
                if other not in links and (carries or not is_held):
                    continue
            elif not pair & links:  # what stands on the scene
                continue
            self.struck.add((touch.first, touch.second))


_Asked = tuple[Array, Array, Array]
"""Positions, velocities and accelerations (k, nq), one row a step."""


def _asked_motion(robot: Robot, q: Array, trajectory: Trajectory) -> _Asked:
    """What a controller asks of the joints while it follows a trajectory, the others being at q."""
    count = round(trajectory.duration / TIME_STEP)
    times = TIME_STEP * np.arange(1.0, 1.0 + count)
    columns = [robot.index(joint) for joint in trajectory.joints]
    still = np.zeros((len(times), len(q)))
    asked = still + q, still, still.copy()
    for whole, some in zip(asked, evaluate_trajectory(trajectory, times), strict=True):
        whole[:, columns] = some
    return asked
