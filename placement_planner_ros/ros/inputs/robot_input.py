"""The robot the node plans for: from a parameter, a topic, or the bundled YuMi."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pinocchio as pin
from builtin_interfaces.msg import Time

from placement_planner_ros.core.body.convex_cover import Cover
from placement_planner_ros.core.errors import ParameterError, PlacementPlannerError, RobotError
from placement_planner_ros.core.meshes.read import Triangles, check_header, read_mesh
from placement_planner_ros.core.robot.announcement import Announcement, announce_arm
from placement_planner_ros.core.robot.geometry import LinkMesh
from placement_planner_ros.core.robot.joint_limits import FIELD, JointLimit, read_joint_limits
from placement_planner_ros.core.robot.model import Arm, Robot
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.weak_cache import weak_lru_cache
from placement_planner_ros.ros.inputs.covers import cover_in, read_kept
from placement_planner_ros.ros.inputs.joint_limits_file import parse_joint_limits
from placement_planner_ros.ros.inputs.mesh_process import MeshProcess
from placement_planner_ros.ros.inputs.reading import NotReadyError, Reading, ShouldStop, State
from placement_planner_ros.ros.inputs.resources import Files, description_text
from placement_planner_ros.ros.parameters.checks import poses_from_list
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.share import share_path


class FramePose(Protocol):
    """T_target_source of two frames outside the URDF (tf2), or None where nobody knows."""

    def __call__(self, target: str, source: str, stamp: Time | None = None) -> pin.SE3 | None:
        """At a stamp; without one, the newest that is known."""
        ...


NEGLIGIBLE = 1e-5
"""m or rad by which the robot may have moved in planning_frame to count as standing still."""


_STILL = 1e-3
"""rad or m by which every joint must have moved less for its meshes to be where they were."""


class DescriptionError(RobotError):
    """The robot's description cannot be read."""

    code = "BAD_ROBOT"


class UnplacedError(DescriptionError):
    """Nobody knows where the robot stands in the planning frame."""


@dataclass(frozen=True, slots=True, eq=False)
class _Read:
    """A robot as its description has it.

    Attributes:
        robot: its root link being the planning frame.
        base: what tf2 is asked for, the robot then being carried there; '' where the description
            tells where it is.
    """

    robot: Robot
    base: str = ""


class RobotInput:
    """Reads robot descriptions, in the background. Safe to use from several threads.

    Until a description comes by topic the bundled YuMi stands in for it. From then on only the
    newest counts: while it is read there is no robot, and none where it cannot be.

    Where planning_frame is no link of the robot, tf2 is asked where it stands in there: at each
    start, by `look_up`.

    Attributes:
        progress: what takes long while the newest description is read; empty where nothing does.

    Args:
        parameters: as at start-up.
        frame_pose: asked where planning_frame is no link of the robot.
        files: finds the meshes that descriptions name.

    Raises:
        RobotError: a description named by a parameter is not there.
    """

    def __init__(self, parameters: ParameterSet, frame_pose: FramePose, files: Files) -> None:
        self._lock = threading.Lock()
        self._frame = str(parameters["planning_frame"])
        self._frame_pose = frame_pose
        self._files = files
        self._reading: Reading[_Read] = Reading("robot", _explain)
        self._placed: tuple[_Read, pin.SE3, Robot] | None = None
        self._stood: tuple[_Read, Array] | None = None
        self._standing: tuple[_Read, Robot] | None = None
        self._joints: frozenset[str] = frozenset()
        self._continuous: frozenset[str] = frozenset()
        given = parameters["robot_description"]
        semantic = parameters["robot_description_semantic"]
        self.follows_topic = not given
        self.follows_semantic_topic = not semantic
        self._arrived = False
        self._progress_listener: Callable[[str], None] | None = None
        self.progress = ""
        self._srdf: str | None = None
        if given:
            self._urdf, self._beside = description_text("robot_description", given, files)
        else:
            self._beside = share_path("urdf", "yumi.urdf")
            self._urdf = self._beside.read_text(encoding="utf-8")
            self._srdf = share_path("urdf", "yumi.srdf").read_text(encoding="utf-8")
        self._limits = _joint_limits(parameters, files)
        if semantic:
            self._srdf, _ = description_text("robot_description_semantic", semantic, files)
        self._key = self._begin()

    def set_description(self, urdf: str) -> bool:
        """Take a URDF from the topic; False where it is the one in use, or being read."""
        with self._lock:
            self._arrived = True
            if urdf == self._urdf and self.state != "bad":
                return False
            if urdf != self._urdf and self.follows_semantic_topic:
                self._srdf = None
            self._urdf, self._beside = urdf, None
            self._reread()
        return True

    def set_semantic(self, srdf: str) -> bool:
        """Take an SRDF from the topic; False where it is the one in use, or being read."""
        with self._lock:
            if srdf == self._srdf and self.state != "bad":
                return False
            self._srdf = srdf
            self._reread()
        return True

    @property
    def robot(self) -> Robot:
        """The robot, its root frame being the planning frame, where it stood at the last look.

        Raises:
            NotReadyError: the newest description is being read.
            PlacementPlannerError: it is unusable.
            UnplacedError: nobody knows where it stands.
        """
        read = self._reading.get(self._key)
        placed = self._placed
        if not read.base:
            return self._robot_of(read)
        return placed[2] if placed is not None and placed[0] is read else self._place(read)

    @property
    def unplaced(self) -> Robot:
        """The same, wherever it stands."""
        return self._robot_of(self._reading.get(self._key))

    def _robot_of(self, read: _Read) -> Robot:
        """With what has been learned where it stood."""
        standing = self._standing
        return standing[1] if standing is not None and standing[0] is read else read.robot

    def standing_at(self, robot: Robot, q: Array) -> Robot:
        """The robot, which stands at q (nq,): see `Robot.standing_at`.

        What that shows is kept, unless another robot has come meanwhile.

        Raises:
            PlacementPlannerError: as `robot`.
        """
        with self._lock:
            if self.robot is not robot:
                return robot.standing_at(q)
            read, stood = self._reading.get(self._key), self._stood
            same = stood is not None and stood[0] is read
            if stood is None or not same or np.abs(stood[1] - q).max(initial=0.0) > _STILL:
                before = self._robot_of(read)
                after = before.standing_at(q)
                self._stood = read, q
                if after is not before:
                    self._standing, self._placed = (read, after), None
            return self.robot

    def look_up(self) -> None:
        """Look where the robot stands now; where nobody knows any more, `robot` says so."""
        try:
            read = self._reading.get(self._key)
            if read.base:
                self._place(read)
        except PlacementPlannerError:
            return

    def moved(self, stamp: Time) -> pin.SE3:
        """What the base had yet to move at a stamp to where `robot` has it: T_planning_planning.

        Raises:
            PlacementPlannerError: as `robot`; or nobody knows where it stood then.
        """
        read, placed = self._reading.get(self._key), self._placed
        if not read.base or placed is None:
            return pin.SE3.Identity()
        T_planning_base = self._frame_pose(self._frame, read.base, stamp)
        if T_planning_base is None:
            raise self._unplaced(read, "at the cloud's stamp")
        return T_planning_base * placed[1].inverse()

    def strayed(self, robot: Robot, key: Hashable, tolerance: float) -> str:
        """Why its base is no more where a robot has it; '' where it is.

        Args:
            key: as it was when that robot was taken; of another description nothing is known.
            tolerance: m and rad by which it may have moved.
        """
        try:
            read = self._reading.get(key)
        except PlacementPlannerError:
            return ""
        if not read.base:
            return ""
        T_planning_base = self._frame_pose(self._frame, read.base)
        if T_planning_base is None:
            return f"tf2 does not know any more where {read.base!r} is in {self._frame!r}"
        # Nothing but fixed joints leads there.
        then = robot.link_pose(pin.neutral(robot.model), read.base)
        way = pin.log6(then.actInv(T_planning_base))
        if max(np.linalg.norm(way.linear), np.linalg.norm(way.angular)) > tolerance:
            return f"the robot's base has moved in {self._frame!r}"
        return ""

    def _place(self, read: _Read) -> Robot:
        T_planning_base = self._frame_pose(self._frame, read.base)
        placed = self._placed
        if T_planning_base is None:
            self._placed = None
            raise self._unplaced(read, "now")
        if placed is not None and placed[0] is read:
            way = placed[1].actInv(T_planning_base)
            if np.abs(pin.log6(way).vector).max() < NEGLIGIBLE:
                return placed[2]
        robot = self._robot_of(read).carried(T_planning_base, self._frame)
        self._placed = read, T_planning_base, robot
        return robot

    def _unplaced(self, read: _Read, when: str) -> UnplacedError:
        return UnplacedError(
            "planning_frame",
            self._frame,
            f"is no link of robot {read.robot.name!r}, and tf2 does not know where {read.base!r} "
            f"is in it {when}; publish that transform, or leave planning_frame empty",
        )

    @property
    def state(self) -> State:
        """Whether there is a robot, as `~/status` says it."""
        state = self._reading.state(self._key)
        if state == "ready":
            try:
                _ = self.robot
            except UnplacedError:
                return "bad"
            except NotReadyError:
                return "reading"
        return state

    @property
    def key(self) -> Hashable:
        """Another one whenever another description is given."""
        return self._key

    @property
    def is_given(self) -> bool:
        """Whether this is the robot meant, rather than a stand-in until one arrives."""
        return not self.follows_topic or self._arrived

    @property
    def joint_names(self) -> frozenset[str]:
        """Movable joints of the newest robot that could be read."""
        return self._joints

    @property
    def continuous_joints(self) -> frozenset[str]:
        """Those of them without end stops."""
        return self._continuous

    @property
    def reading(self) -> Reading[Any]:
        """Where descriptions are read."""
        return self._reading

    def follow_progress(self, listener: Callable[[str], None]) -> None:
        """Call this with words for each piece of work that takes long."""
        self._progress_listener = listener

    def wait(self, patience: float | None = None) -> None:
        """Return once the newest description is read, or cannot be."""
        self._reading.wait(self._key, patience)

    def _reread(self) -> None:
        """Begin to read what is given now, and stop reading what was; lock held."""
        self._reading.forget(self._key)
        self._key = self._begin()

    def _begin(self) -> Hashable:
        urdf, srdf, beside = self._urdf, self._srdf, self._beside
        trusted = not self._arrived

        def read(should_stop: ShouldStop) -> _Read:
            with MeshProcess(should_stop) as process:
                meshes = _ReadMeshes(self._files, process, trusted, beside)
                try:
                    made = self._read(urdf, srdf, meshes, _Covers(process, self._tell))
                finally:
                    self._tell("")
            self._continuous = made.robot.continuous
            self._joints = frozenset(made.robot.joint_names)
            return made

        key = object()  # the same text is read anew where it could not be before
        self._reading.want(key, read, lasting=True)
        return key

    def _tell(self, progress: str) -> None:
        self.progress = progress
        if progress and self._progress_listener is not None:
            self._progress_listener(progress)

    def _read(self, urdf: str, srdf: str | None, meshes: _ReadMeshes, covers: _Covers) -> _Read:
        try:
            robot = Robot.from_urdf(urdf, meshes, srdf, self._limits, covers)
            if not self._frame or self._frame == robot.root_link:
                return _Read(robot)
            if robot.has_link(self._frame):
                return _Read(robot.seen_from(self._frame))
            return _Read(robot.carried(pin.SE3.Identity(), self._frame), base=robot.root_link)
        except RobotError as error:
            raise DescriptionError(error.field, error.value, error.remedy) from error


def _joint_limits(parameters: ParameterSet, files: Files) -> dict[str, JointLimit]:
    """What MoveIt's parameters say of joints: a file, or else each limit by itself.

    Raises:
        RobotError: they are not of MoveIt's form.
    """
    limits: dict[str, dict[str, Any]] = {}
    given = parameters[FIELD]
    if given:
        try:
            path = files.find(given, trusted=True)
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            words = f"give MoveIt's joint_limits.yaml, a path or a URI: {error}"
            raise RobotError(FIELD, given[:60], words) from error
        return parse_joint_limits(text)
    for name, value in parameters.joint_limits.items():
        joint, _, what = name.rpartition(".")
        limits.setdefault(joint, {})[what] = value
    return read_joint_limits(limits)


class _ReadMeshes:
    """The meshes of one description."""

    def __init__(
        self, files: Files, process: MeshProcess, trusted: bool, beside: Path | None
    ) -> None:
        self._files = files
        self._process = process
        self._trusted = trusted
        self._beside = beside

    def find(self, uri: str) -> Path:
        """The file that a mesh's URI names."""
        path = self._files.find(uri, trusted=self._trusted, beside=self._beside)
        check_header(path)
        return path

    def read(self, path: Path) -> tuple[Array, Triangles]:
        """Vertices and triangles of a file."""
        if path.resolve().is_relative_to(share_path("urdf").resolve()):
            return read_mesh(path)  # the bundled robot's, known to be good
        return read_kept(self._process, path)


class _Covers:
    """Makes the convex covers of one description, in another process, where no other has yet."""

    def __init__(self, process: MeshProcess, tell: Callable[[str], None]) -> None:
        self._process = process
        self._tell = tell

    def __call__(self, meshes: Sequence[LinkMesh]) -> list[Cover]:
        """The cover of each mesh; its hull where that takes too long, or too much memory."""
        return [self._cover(mesh, k + 1, len(meshes)) for k, mesh in enumerate(meshes)]

    def _cover(self, mesh: LinkMesh, number: int, count: int) -> Cover:
        def tell() -> None:
            self._tell(f"cover {number} of {count} (link {mesh.link})")

        return cover_in(self._process, mesh.vertices, mesh.triangles, mesh.tolerance, tell)


def _explain(error: Exception) -> PlacementPlannerError:
    words = f"cannot be read: {type(error).__name__}: {error}"
    return DescriptionError("robot_description", "the newest", words)


def make_arms(robot: Robot, parameters: ParameterSet) -> tuple[Arm, ...]:
    """The candidate arms that the parameters describe.

    Raises:
        RobotError: an arm does not fit the robot.
        GraspError: a grasp is bad.
    """
    return tuple(make_arm(robot, parameters, name) for name in parameters["arms"])


def make_arm(robot: Robot, parameters: ParameterSet, name: str) -> Arm:
    """The arm of that name.

    Raises:
        RobotError: it does not fit the robot.
        GraspError: a grasp is bad.
    """
    tip = parameters[f"{name}.tip_frame"]
    if not tip:
        raise RobotError(f"{name}.tip_frame", tip, "name the link that the grasps refer to")
    rest = ("joints", "grasps", "touch_links", "gripper_joints", "gripper_open")
    return _arm(robot, name, tip, *(tuple(parameters[f"{name}.{part}"]) for part in rest))


@weak_lru_cache("robot", maxsize=16)
def _arm(
    robot: Robot,
    name: str,
    tip: str,
    joints: tuple[str, ...],
    grasps: tuple[float, ...],
    touch_links: tuple[str, ...],
    gripper_joints: tuple[str, ...],
    gripper_open: tuple[float, ...],
) -> Arm:
    """Kept from start to start."""
    return robot.arm(
        name,
        tip,
        joints=joints or None,
        grasps=poses_from_list(f"{name}.grasps", grasps),
        also_touch=touch_links,
        gripper_joints=gripper_joints,
        gripper_open=gripper_open,
    )


def announced(robot: Robot, parameters: ParameterSet, arm: Arm) -> Announcement:
    """What was derived or assumed for an arm of these parameters."""
    return _announced(robot, arm, not parameters[f"{arm.name}.joints"])


@weak_lru_cache("robot", maxsize=16)
def _announced(robot: Robot, arm: Arm, derived: bool) -> Announcement:
    """Kept from start to start."""
    return announce_arm(robot, arm, derived=derived)


def require_known(robot: Robot, parameters: ParameterSet, names: Iterable[str]) -> None:
    """Refuse links and joints of these parameters that the robot does not have.

    Raises:
        RobotError: there is one.
    """
    arms = parameters["arms"]
    links = {f"{arm}.{part}" for arm in arms for part in ("tip_frame", "touch_links")}
    joints = {f"{arm}.{part}" for arm in arms for part in ("joints", "gripper_joints")}
    for name in names:
        value = parameters[name] if name in links | joints else []
        for each in filter(None, [value] if isinstance(value, str) else value):
            if name in links and not robot.has_link(each):
                raise RobotError(name, each, f"is no link of robot {robot.name!r}")
            if name in joints and each not in robot.joint_names:
                raise RobotError(name, each, f"is no movable joint of robot {robot.name!r}")
        if name == "assumed_joints":
            require_assumed(robot, parameters)


def require_assumed(robot: Robot, parameters: ParameterSet) -> None:
    """Refuse assumed values of joints that the robot does not have, or that follow others.

    Raises:
        ParameterError: there is one.
    """
    for joint in parameters.assumed_joints:
        if joint in robot.mimics:
            master = robot.mimics[joint].master
            raise ParameterError("assumed_joints", joint, f"follows {master}; give that one")
        if joint not in robot.joint_names:
            words = f"is no movable joint of robot {robot.name!r}"
            raise ParameterError("assumed_joints", joint, words)
