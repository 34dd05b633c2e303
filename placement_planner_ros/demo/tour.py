"""Several things put down one after the other: planned by the node, carried out by physics.

Each is confirmed from where it really came to stand, so that the next is planned around it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from trajectory_msgs.msg import JointTrajectory

from placement_planner_ros.client import PlacementClient, PlacementError, Solution
from placement_planner_ros.core.types import Trajectory
from placement_planner_ros.demo.errors import DemoError
from placement_planner_ros.demo.physics.carrying_out import CarryingOut
from placement_planner_ros.demo.physics.model import SimulatedThing
from placement_planner_ros.demo.physics.outcome import CarryOutcome, apart
from placement_planner_ros.demo.results import pose_of
from placement_planner_ros.demo.search import BUSY, PAGE, Found, search, wait_until_ready
from placement_planner_ros.demo.setting import Setting
from placement_planner_ros.pictures.stage_set import Look
from placement_planner_ros.progress import ProgressLine
from placement_planner_ros.ros.tools.scene_publisher import ScenePublisher
from placement_planner_ros.scenes.grasped_object import GraspedObject
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.yumi import start_configuration, yumi_arm

_SHOWN = 2.0
"""Seconds for which the robot is shown at rest before the next run begins, so that the node knows
it there and can prepare what it knows of before."""
_WAY_UP = {"toy_table": [0.0, 0.0, 1.0], "wine_glass": [0.0, 0.0, 1.0]}
"""What points up wherever a thing stands, for those that people would not put on their heads."""
_TOLD_WITHIN = 10.0
"""Seconds within which the node must have taken its parameters."""
_AT_START = 1e-3
"""rad or m by which a trajectory may begin beside where the robot stands."""


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """One thing put down.

    Attributes:
        thing: what was put down.
        found: by the search.
        looks: at what came of it, moment by moment.
    """

    thing: GraspedObject
    found: Found
    looks: Sequence[Look]
    outcome: CarryOutcome

    @property
    def solution(self) -> Solution:
        """The one that was carried out."""
        return self.found.improvements[-1]

    @property
    def name(self) -> str:
        """Of the thing, for people."""
        return self.thing.name.replace("_", " ")

    @property
    def words(self) -> str:
        """What came of it."""
        outcome = self.outcome
        struck = "; ".join(f"{one} struck {other}" for one, other in outcome.struck)
        return (
            f"it arrived {1000.0 * outcome.off:.2f} mm from its planned place and stands "
            f"{1000.0 * outcome.moved:.2f} mm from it, tilted by "
            f"{np.rad2deg(outcome.tilted):.2f}°{struck and '; ' + struck}"
        )


class Tour:
    """A tour of one scene.

    Attributes:
        setting: scene and robot.
        seconds: see below.
        stops: so far.

    Args:
        planner: of a node that is ready.
        planner_name: of that node.
        publisher: of the scene, and of where the robot is.
        seconds: to search on for after the first placement of each thing.
        check: raises where node or publisher have died.
    """

    def __init__(
        self,
        setting: Setting,
        planner: PlacementClient,
        planner_name: str,
        publisher: ScenePublisher,
        seconds: float,
        check: Callable[[], None],
        line: ProgressLine,
    ) -> None:
        self.setting, self.seconds = setting, seconds
        self._robot = setting.robot
        self._planner, self._publisher = planner, publisher
        self._check, self._line = check, line
        # answered in the thread that publishes the scene
        self._parameters = AsyncParameterClient(publisher, planner_name)
        self._standing: list[SimulatedThing] = []
        self.stops: list[Stop] = []

    def put_down(self, name: str) -> Stop:
        """Plan for a thing, carry it out, and tell the node where it came to stand.

        Raises:
            DemoError: no placement was found, or the node does not answer.
        """
        held = object_by_name(name)
        positions = start_configuration(name)
        self._publisher.show(positions, at_rest=True)
        self._tell(held)
        time.sleep(_SHOWN)
        found = search(self._planner, self.seconds, self._check, self._line)
        solution = found.improvements[-1]
        still = self._planner.validity(solution)
        if not still:
            raise DemoError(f"the placement of {name} does not hold any more: {still.reason}", BUSY)
        carrying = self._carrying(held, self._robot.configuration(positions), solution)
        looks = self._carried_out(carrying)
        places = looks[-1].places
        stop = Stop(
            held,
            found,
            looks,
            CarryOutcome.of(
                held.center_of_mass,
                pose_of(solution.pose.pose),
                carrying.arrived,
                places[name],
                carrying.struck,
            ),
        )
        self._confirm(solution, places[name])
        things = [*self._standing, carrying.thing]
        self._standing = [replace(each, T_world_thing=places[each.name]) for each in things]
        self.stops.append(stop)
        return stop

    @property
    def knocked(self) -> float:
        """Metres that the worst of the things was moved by what came after it."""
        last, moved = self.stops[-1].looks[-1].places, []
        for stop in self.stops:
            key, center = stop.thing.name, stop.thing.center_of_mass
            moved.append(apart(center, stop.looks[-1].places[key], last[key]))
        return max(moved)

    def _tell(self, held: GraspedObject) -> None:
        """Have the node know what is held from now on."""
        told = self._parameters.set_parameters_atomically(_parameters(held))
        end = time.monotonic() + _TOLD_WITHIN
        while not told.done():
            self._check()
            if time.monotonic() > end:
                raise DemoError("the node does not answer any more", BUSY)
            time.sleep(0.05)
        result = told.result().result
        if not result.successful:
            raise DemoError(f"the node refuses {held.name}: {result.reason}", PAGE)
        wait_until_ready(self._planner, self._check, self._line)

    def _carrying(self, held: GraspedObject, q: np.ndarray, solution: Solution) -> CarryingOut:
        arm = yumi_arm(self._robot, solution.arm, held.grasps[solution.arm])
        retreat = solution.retreat_trajectory
        carrying = CarryingOut(
            self._robot,
            arm,
            arm.grasps[solution.grasp],
            q,
            self.setting.scene.parts,
            SimulatedThing(
                held.name,
                tuple(part.vertices for part in held.parts),
                held.center_of_mass,
                pose_of(solution.pose.pose),
            ),
            self._standing,
            _trajectory(solution.trajectory),
            solution.approach_start,
            None if retreat is None else _trajectory(retreat),
        )
        first = self._robot.with_positions(
            q, dict(zip(carrying.trajectory.joints, carrying.trajectory.positions[0], strict=True))
        )
        if np.abs(first - q).max() > _AT_START:
            raise DemoError("the node planned from where the robot is no more", BUSY)
        return carrying

    def _carried_out(self, carrying: CarryingOut) -> list[Look]:
        """Every look; the node is told of the joints meanwhile."""
        looks: list[Look] = []
        names = [name for name in self._robot.joint_names if name not in self._robot.mimics]
        columns = [self._robot.index(name) for name in names]
        for look in carrying.looks():
            looks.append(look)
            joints = dict(zip(names, look.q[columns].tolist(), strict=True))
            self._publisher.show(joints, at_rest=False)
            self._line.show(
                f"  {look.time:4.1f} of {carrying.duration:.1f} s  physics: {look.stage}"
            )
            self._check()
        return looks

    def _confirm(self, solution: Solution, place: pin.SE3) -> None:
        try:
            self._planner.confirm_placed(solution, pin.SE3ToXYZQUAT(place).tolist())
        except PlacementError as error:
            self._check()
            raise DemoError(f"the node refuses what was put down: {error}", PAGE) from error


def _parameters(held: GraspedObject) -> list[Parameter]:
    """What the node has to know of a thing."""
    values: dict[str, list] = {
        "object.vertices": held.vertices.ravel().tolist(),
        "object.triangles": held.triangles.ravel().tolist(),
        "object.center_of_mass": held.center_of_mass.tolist(),
        "object.up": _WAY_UP.get(held.name, []),
    }
    for arm, grasps in held.grasps.items():
        values[f"{arm}.grasps"] = np.ravel([pin.SE3ToXYZQUAT(T) for T in grasps]).tolist()
    kinds = Parameter.Type.INTEGER_ARRAY, Parameter.Type.DOUBLE_ARRAY
    return [
        Parameter(name, kinds[name != "object.triangles"], value) for name, value in values.items()
    ]


def _trajectory(message: JointTrajectory) -> Trajectory:
    """What a controller takes from the message."""
    points = message.points
    return Trajectory(
        tuple(message.joint_names),
        np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points]),
        np.array([p.positions for p in points]),
        np.array([p.velocities for p in points]),
        np.array([p.accelerations for p in points]),
    )
