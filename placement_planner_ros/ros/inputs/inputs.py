"""Everything the node is told."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from builtin_interfaces.msg import Time
from rclpy.clock import Clock
from sensor_msgs.msg import JointState, PointCloud2

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.errors import CloudError, JointStateError, PlacementPlannerError
from placement_planner_ros.core.measured_points import measured_points
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.scene.flying_pixels import flying_pixels
from placement_planner_ros.ros.inputs.cloud_store import CloudStore, PointSet
from placement_planner_ros.ros.inputs.frames import CloudFrameError, cloud_pose, is_eye, turned_axes
from placement_planner_ros.ros.inputs.furniture import WORLD_LINKS, FixedLinks, fixed_links
from placement_planner_ros.ros.inputs.joint_states import JointStates, RobotMovingError
from placement_planner_ros.ros.inputs.known_objects import KnownObjects
from placement_planner_ros.ros.inputs.known_surface import KnownSurface, PlacedBody
from placement_planner_ros.ros.inputs.object_input import ObjectInput
from placement_planner_ros.ros.inputs.point_cloud import FAR_M, coordinates_from_message
from placement_planner_ros.ros.inputs.reading import NotReadyError, Reading
from placement_planner_ros.ros.inputs.resources import Files
from placement_planner_ros.ros.inputs.robot_input import DescriptionError, RobotInput
from placement_planner_ros.ros.inputs.transforms import Transforms
from placement_planner_ros.ros.log import Log
from placement_planner_ros.ros.parameters.values import ParameterSet


class _Received(NamedTuple):
    """A cloud that came, taken at a time by the steady clock; arrivals grow.

    Where its frame is said to be by a parameter, `declared` is that pose once it was taken in.
    """

    message: PointCloud2
    taken: float
    arrival: int
    declared: pin.SE3 | None = None


class Inputs:
    """Robot, clouds, joint states and object. Safe to use from several threads.

    Args:
        topics: cloud topics; of each a cloud is needed.
        transforms: tf2, where there is one.
        clock: the node's, to judge how old a stamp is.
        log: hears of what is read.

    Attributes:
        turned: by topic, what is wrong with the axes of its clouds' frame, in words.
    """

    def __init__(
        self,
        parameters: ParameterSet,
        topics: Iterable[str],
        transforms: Transforms | None = None,
        clock: Clock | None = None,
        log: Log | None = None,
    ) -> None:
        files = Files(parameters["package_paths"], parameters["file_roots"])
        self.robot = RobotInput(parameters, files, log)
        self.joints = JointStates()
        self.object = ObjectInput(parameters, files, log)
        self.clouds = CloudStore(tuple(topics))
        self.known = KnownObjects(files)
        self._transforms = transforms
        self._clock = clock
        self._lock = threading.Lock()
        self._known_joints: tuple[frozenset[str], frozenset[str]] = frozenset(), frozenset()
        self._waiting: dict[str, _Received] = {}
        self._arrivals = 0
        self._frames: dict[str, str] = {}
        self.turned: dict[str, str] = {}

    def take_joint_state(self, message: JointState) -> None:
        """Merge a joint state.

        Raises:
            JointStateError: it is malformed; joints of which it tells a position are taken.
        """
        names, position = message.name, message.position
        stamp = _seconds(message.header.stamp)
        if stamp is not None and stamp < 0.0:
            raise JointStateError("joint_states: header.stamp", stamp, "must not be negative")
        # another robot has other joints
        known = self.robot.joint_names, self.robot.continuous_joints
        if known != self._known_joints:
            self._known_joints = known
            self.joints.keep(*known)
        if len(position) == len(names):
            # What the robot does not have is not kept: nobody would ever forget it.
            mine = [i for i, name in enumerate(names) if name in known[0]]
            names, position = [names[i] for i in mine], [position[i] for i in mine]
        # without a stamp it counts as of now, by the clock by which clouds are stamped
        now = self._now() if stamp is None else stamp
        self.joints.update(names, position, time.monotonic(), now)

    def take_cloud(self, topic: str, message: PointCloud2, parameters: ParameterSet) -> None:
        """Store a cloud in the planning frame.

        Raises:
            PlacementPlannerError: it is malformed, or nobody knows its frame, or the robot yet. A
                cloud whose frame or robot is unknown is tried again at the next snapshot. One whose
                sensor the robot has moved since is left out, without a word where the topic has
                delivered before.
        """
        # whatever waited on this topic is outdated
        with self._lock:
            self._frames[topic] = message.header.frame_id
            self._waiting.pop(topic, None)
            self._arrivals += 1
            arrival = self._arrivals
        received = _Received(message, time.monotonic() - self._age(message), arrival)
        try:
            self._store(topic, received, parameters, wait=True)
        except (CloudFrameError, NotReadyError, DescriptionError) as error:
            # an unknown frame may become known; where the sensor was before a motion never will be
            if not isinstance(error.__cause__, RobotMovingError):
                with self._lock:
                    self._waiting[topic] = received
            elif topic in self.clouds.ages(0.0):
                return
            raise

    def retry_clouds(self, parameters: ParameterSet) -> None:
        """Take clouds whose frame was unknown when they came, where it is known now.

        And anew those whose sensor is said to be elsewhere since, but for what was merged.
        """
        with self._lock:
            waiting = dict(self._waiting)
        for topic, received in waiting.items():
            # one that was placed by a parameter is placed anew only where another pose is said
            said = parameters.sensor_pose(self._frames[topic])
            if received.declared is not None and said in (None, received.declared):
                continue
            error = None
            try:
                self._store(topic, received, parameters)
            except PlacementPlannerError as refused:
                error = refused
            with self._lock:
                if self._waiting.get(topic) is not received:
                    continue  # another one has come meanwhile
                if error is None:
                    self._waiting.pop(topic)
                else:
                    self.clouds.refuse(topic, error)

    def joints_to_sensors(self, robot: Robot, parameters: ParameterSet) -> set[str]:
        """Joints on which the place of a cloud's frame depends."""
        return {
            joint
            for frame in self._sensor_links(robot)
            if parameters.sensor_pose(frame) is None
            for joint in robot.joints_to(frame)
        }

    def _sensor_links(self, robot: Robot, more: Iterable[str] = ()) -> set[str]:
        """Links that are the frame of a cloud, or named here."""
        with self._lock:
            frames = {*self._frames.values(), *more}
        return {frame for frame in frames if robot.has_link(frame)}

    def state(self, parameters: ParameterSet) -> tuple[object, ...]:
        """Equal at two moments where nothing that a snapshot is taken of has changed."""
        robot = self.robot.key, self.robot.state
        # counters and whole objects, so that two states are compared at once
        changes = self.clouds.changes + self.known.changes, tuple(self.known.placed.values())
        return changes, self.joints.positions(), self.object.key, robot, parameters

    def fixed_links(
        self, robot: Robot, arms: Sequence[Arm], parameters: ParameterSet
    ) -> FixedLinks:
        """The robot without its furniture, and that furniture."""
        # the chains that end at hands and at sensors belong to the robot
        ends = self._sensor_links(robot, parameters["sensor_frames"])
        ends |= {arm.tip_frame for arm in arms}
        return fixed_links(robot, tuple(sorted(ends)), tuple(parameters[WORLD_LINKS]))

    def known_surfaces(self, robot: Robot, parameters: ParameterSet) -> tuple[KnownSurface, ...]:
        """The known objects, and what was placed, in the planning frame.

        Raises:
            PlacementPlannerError: one is unusable, being read, or in a frame that nobody knows.
        """
        prefix = parameters["frame_prefix"]
        return self.known.surfaces(
            lambda frame: self._frame_pose(frame.removeprefix(prefix), Time(), robot, parameters)
        )

    @property
    def readings(self) -> tuple[Reading[Any], ...]:
        """Where descriptions and meshes are read."""
        return self.robot.reading, self.object.reading, self.known.reading

    def confirm(self, run: int, body: Body, T_world_object: pin.SE3) -> None:
        """What the run placed stands there: its surface is part of the environment now."""
        self.known.confirm(run, PlacedBody.at(body, T_world_object))

    def remove(self, run: int, padding: float) -> bool:
        """Forget what that run placed, and points accumulated in it; whether it stood.

        Args:
            padding: of the object, within which points are taken for its own, metres.
        """
        thing = self.known.remove(run)
        if thing is None:
            return False
        # else its accumulated points would stay there as an obstacle
        self.clouds.forget(lambda points: thing.holds(points, padding))
        return True

    def clear(self) -> None:
        """Forget accumulated points and what was placed."""
        self.clouds.clear()
        for run in self.known.placed:
            self.known.remove(run)

    def _age(self, message: PointCloud2) -> float:
        """Seconds since the cloud was taken, by its stamp; 0 without one."""
        stamp = _seconds(message.header.stamp)
        if stamp is None:
            return 0.0
        if stamp < 0.0:
            raise CloudError("cloud header.stamp", stamp, "must not be negative; 0 is no stamp")
        return max(0.0, self._now() - stamp)

    def _now(self) -> float:
        """Seconds of the clock by which stamps are; it may be set back or stand still."""
        return (self._clock or Clock()).now().nanoseconds * 1e-9

    def _store(
        self, topic: str, received: _Received, parameters: ParameterSet, *, wait: bool = False
    ) -> None:
        message, taken, arrival, _ = received
        robot, header = self.robot.robot, message.header
        frame = header.frame_id.removeprefix(parameters["frame_prefix"])
        # where the frame was when the cloud was taken
        T_planning_cloud = self._frame_pose(frame, header.stamp, robot, parameters, wait=wait)
        coordinates = coordinates_from_message(message)
        points = measured_points(coordinates, T_planning_cloud.homogeneous, FAR_M)
        # without the prefix, which the links of the robot do not have
        self._frames[topic] = frame
        self.turned[topic] = turned_axes(frame, points, T_planning_cloud)
        # only where a sensor is at the frame's origin do lines of sight begin there
        eye = is_eye(frame, message.height, parameters)
        origin = np.array(T_planning_cloud.translation) if eye else None
        self.clouds.add(PointSet(points, origin, False, topic, taken, arrival))
        if parameters["cloud.mode"] == "merge":
            if origin is not None:  # once among others, they cannot be told any more
                points = points[~flying_pixels(points, origin)]
            self.clouds.merge(points, parameters["cloud.cell_size"])
        elif parameters.sensor_pose(frame) is not None:
            with self._lock:  # it may be told to be elsewhere
                self._waiting[topic] = received._replace(declared=T_planning_cloud)

    def _frame_pose(
        self, frame: str, stamp: Time, robot: Robot, parameters: ParameterSet, *, wait: bool = False
    ) -> pin.SE3:
        """T_planning_frame at a stamp; see `cloud_pose`.

        Args:
            wait: a little for its transform.
        """

        def joints(names: Sequence[str]) -> dict[str, float]:
            rest_speed, timeout = parameters["rest_speed"], parameters["joint_state_timeout"]
            now, assumed = time.monotonic(), parameters.assumed_joints
            return self.joints.at(names, _seconds(stamp), now, timeout, rest_speed, assumed)

        def transform(name: str) -> pin.SE3 | None:
            tf = self._transforms
            return None if tf is None else tf.pose(robot.root_link, name, stamp, wait=wait)

        return cloud_pose(frame, parameters, robot, joints, transform)


def _seconds(stamp: Time) -> float | None:
    """A stamp in seconds; None where it is 0, which is none."""
    return None if stamp.sec == 0 and stamp.nanosec == 0 else stamp.sec + stamp.nanosec * 1e-9
