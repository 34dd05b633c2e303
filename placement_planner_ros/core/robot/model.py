"""Any URDF as one immutable value: kinematics, limits, collision geometry, arms."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from numbers import Real

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from placement_planner_ros.core.errors import (
    GraspError,
    JointStateError,
    RobotError,
    StartError,
    listed,
)
from placement_planner_ros.core.robot import allowed_pairs as pairs
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.description import Mimic, read_urdf
from placement_planner_ros.core.robot.geometry import (
    CoverMaker,
    LinkCover,
    MeshFiles,
    PackageDirs,
    build_geometry,
    make_covers,
)
from placement_planner_ros.core.robot.joint_limits import Assumed, JointLimit
from placement_planner_ros.core.types import Array, frozen_array
from placement_planner_ros.core.weak_cache import weak_lru_cache

LIMIT_TOLERANCE = 1e-6
"""rad or m by which a measured joint may exceed its limit before `limit_violations` says so."""

FAR_BEYOND = 0.1
"""rad or m beyond its limit from which on a value is none of this joint, or in another unit."""

FAR_GRASP = 100.0
"""Metres from the tip frame beyond which the origin of an object in hand is a mistake."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Robot:
    """A robot read from its URDF; never modified after construction.

    A configuration q is (nq,): one coordinate per movable joint, in the order of `joint_names`.

    Attributes:
        name: of the robot.
        root_link: the frame in which everything is, by default the link that nothing carries.
        model: pinocchio model, nq == nv == len(joint_names).
        geometry: collision geometry; its collision pairs are those self-collision checks need.
        geometry_links: link of each of geometry.geometryObjects.
        covers: of each of geometry.geometryObjects that is a mesh and not convex a convex cover
            with the mesh, the same for all with the same file and scale; of all others None.
        joint_names: (nq) movable joints, mimicking ones included.
        lower, upper: (nq,) joint limits, rad or m; those of joints without end stops hold for
            plans alone (`description.CONTINUOUS_RANGE`).
        continuous: joints without end stops, which may have been turned any number of times.
        velocity_limits: (nq,) rad/s or m/s.
        acceleration_limits: (nq,) rad/s² or m/s²; nobody states those that `assumed` names.
        assumed: velocity and acceleration limits that nobody states.
        mimics: joints that follow another.
        allowed_pairs: sorted link pairs that self-collision checks leave out.
        left_out: those of them that no SRDF names, and why; None where there is an SRDF.
        passive: joints that no motor drives, as the SRDF says.
        warnings: what was decided where the description was silent.
    """

    name: str
    root_link: str
    model: pin.Model
    geometry: pin.GeometryModel
    geometry_links: tuple[str, ...]
    covers: tuple[LinkCover | None, ...]
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity_limits: Array
    acceleration_limits: Array
    assumed: tuple[Assumed, ...]
    mimics: Mapping[str, Mimic]
    continuous: frozenset[str]
    allowed_pairs: frozenset[pairs.Pair]
    left_out: tuple[pairs.LeftOut, ...] | None
    passive: frozenset[str]
    warnings: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "velocity_limits", "acceleration_limits"):
            array = frozen_array(getattr(self, name), (len(self.joint_names),))
            object.__setattr__(self, name, array)

    @classmethod
    def from_urdf(
        cls,
        urdf_text: str,
        package_dirs: PackageDirs | MeshFiles = (),
        srdf: str | None = None,
        joint_limits: Mapping[str, JointLimit] | None = None,
        cover: CoverMaker = make_covers,
    ) -> Robot:
        """Read a robot.

        Args:
            urdf_text: the URDF itself, not a path.
            package_dirs: where `package://` URIs lead: package name -> share folder, or folders
                that hold packages (or that mesh paths are relative to), or what finds and reads
                mesh files.
            srdf: text that lists disabled collisions; without it they are derived
                (`derive_allowed_pairs`).
            joint_limits: what else is stated of joints (`read_joint_limits`).
            cover: makes the covers of its meshes.

        Raises:
            RobotError: the description or its geometry is unusable; the message names the part.
        """
        # Kinematics, then geometry.
        description = read_urdf(urdf_text, joint_limits)
        model = description.build_model()
        # In the order of their coordinates.
        joints = [description.joints[name] for name in model.names[1:]]
        geometry, geometry_links, covers, notes = build_geometry(
            description.root, model, package_dirs, cover
        )
        links = tuple(f.name for f in model.frames if f.type == pin.FrameType.BODY)
        warnings = [*description.warnings, *notes]
        left_out: tuple[pairs.LeftOut, ...] | None = None
        passive: frozenset[str] = frozenset()
        # Pairs to leave out: of the SRDF, or derived.
        if srdf is None:
            names = [joint.name for joint in joints]
            ties = [
                (row, names.index(mimic.master), mimic.multiplier, mimic.offset)
                for row, mimic in enumerate(joint.mimic for joint in joints)
                if mimic is not None
            ]
            left_out = pairs.derive_allowed_pairs(
                np.array(ties).reshape(-1, 4), model, geometry, geometry_links, covers
            )
            allowed = frozenset(each.links for each in left_out)
            warnings.extend(_said_of(left_out))
        else:
            semantic = pairs.read_srdf(srdf, links)
            allowed, passive = semantic.allowed, semantic.passive
            warnings.extend(semantic.warnings)
        # What is left is checked.
        _add_collision_pairs(geometry, geometry_links, allowed)
        return cls(
            name=str(description.root.get("name")),
            root_link=links[0],
            model=model,
            geometry=geometry,
            geometry_links=geometry_links,
            covers=covers,
            joint_names=tuple(joint.name for joint in joints),
            lower=np.array([joint.lower for joint in joints]),
            upper=np.array([joint.upper for joint in joints]),
            velocity_limits=np.array([joint.velocity for joint in joints]),
            acceleration_limits=np.array([joint.acceleration for joint in joints]),
            assumed=tuple(each for joint in joints for each in joint.assumed),
            mimics={joint.name: joint.mimic for joint in joints if joint.mimic is not None},
            continuous=frozenset(joint.name for joint in joints if joint.continuous),
            allowed_pairs=allowed,
            left_out=left_out,
            passive=passive,
            warnings=tuple(warnings),
        )

    def standing_at(self, q: Array) -> Robot:
        """This robot, which stands at q (nq,); itself where that shows nothing new.

        Without an SRDF, links at most `allowed_pairs.NEARBY` joints apart whose meshes overlap
        there are left out of self-collision checks: where the robot itself stands, they are not in
        each other. Only its pairs differ then.
        """
        if self.left_out is None:
            return self
        # Pairs that overlap there, if any.
        found = _near_pairs(self).left_out_at(q)
        if not found:
            return self
        return _without_pairs(self, found)

    @property
    def turnable(self) -> frozenset[str]:
        """Joints that turn two times around or more."""
        # A range of two turns, of joints that turn and are tied to none.
        around = self.upper - self.lower >= 4.0 * np.pi - LIMIT_TOLERANCE
        kinds = [joint.shortname() for joint in self.model.joints[1:]]
        return frozenset(
            name
            for name, far, kind in zip(self.joint_names, around, kinds, strict=True)
            if far and "JointModelP" not in kind and name not in self._coupled
        )

    @property
    def _coupled(self) -> set[str]:
        """Joints that follow another, and those that are followed."""
        return {*self.mimics, *(mimic.master for mimic in self.mimics.values())}

    def index(self, joint: str) -> int:
        """Coordinate of a joint in q.

        Raises:
            RobotError: no movable joint of that name.
        """
        if joint not in self.joint_names:
            raise RobotError("joint", joint, f"name one of {list(self.joint_names)}")
        return self.joint_names.index(joint)

    @property
    def needed_joints(self) -> tuple[str, ...]:
        """Joints whose values must be known: all but those that mimic another, are passive, or move
        no shape."""
        # Joints on the way to any shape.
        moving = {g.parentJoint for g in self.geometry.geometryObjects}
        carrying = {joint for shape in moving for joint in self.model.supports[shape]}
        movers = {str(self.model.names[joint]) for joint in carrying}
        movers |= {mimic.master for name, mimic in self.mimics.items() if name in movers}
        return tuple(
            name
            for name in self.joint_names
            if name in movers and name not in self.mimics and name not in self.passive
        )

    def configuration(self, positions: Mapping[str, float], also: Iterable[str] = ()) -> Array:
        """q (nq,) from joint values; other names are ignored, mimicking joints follow.

        Joints that need no value and have none are at zero, or the limit next to it. Values beyond
        the limits are taken as they are: see `limit_violations`.

        Args:
            also: joints that must have a value besides `needed_joints`.

        Raises:
            JointStateError: a joint is missing or not finite; the message names them.
        """
        # Missing ones first.
        wanted = {*self.needed_joints, *also}.difference(self.mimics)
        missing = [name for name in self.joint_names if name in wanted and name not in positions]
        if missing:
            raise JointStateError("joint_states: missing", missing, "give these joints too")
        # All that is given; the others at zero or the limit next to it.
        known = [n for n in self.joint_names if n in positions and n not in self.mimics]
        q = np.clip(np.zeros(len(self.joint_names)), self.lower, self.upper)
        return self._filled(q, {name: positions[name] for name in known})

    def with_positions(self, q: Array, positions: Mapping[str, float]) -> Array:
        """A copy of q (nq,) with some joints set; mimicking joints follow their masters, whatever
        is given for them.

        Raises:
            RobotError: no movable joint of that name.
            JointStateError: a value is not finite.
        """
        return self._filled(np.array(q, dtype=np.float64), positions)

    def unwound(self, q: Array) -> Array:
        """q (nq,), continuous joints turned by whole turns to within half a turn of zero.

        A plan begins there. Coupled joints stay as they are.
        """
        # Whole turns of joints that are tied to none.
        endless = np.isin(self.joint_names, list(self.continuous - self._coupled))
        return np.asarray(q - np.where(endless, 2.0 * np.pi * np.round(q / (2.0 * np.pi)), 0.0))

    def apart(self, a: Array, b: Array) -> Array:
        """(nq,) how far each joint is from a to b, (nq,) both; continuous ones the shorter way.

        0 for joints that follow others, which may do so at another pace.
        """
        # Of joints without end stops without whole turns.
        away = np.abs(a - b)
        endless = np.isin(self.joint_names, list(self.continuous))
        wrapped = np.abs(away - 2.0 * np.pi * np.round(away / (2.0 * np.pi)))
        following = np.isin(self.joint_names, list(self.mimics))
        return np.where(following, 0.0, np.where(endless, wrapped, away))

    def with_open_hand(self, q: Array, arm: Arm) -> Array:
        """A copy of q (nq,) with the arm's gripper open."""
        return self.with_positions(q, dict(zip(arm.gripper_joints, arm.gripper_open, strict=True)))

    def require_plausible(self, q: Array, joints: Collection[str]) -> None:
        """Refuse a configuration q (nq,) in which one of these joints is far beyond its limits.

        Raises:
            StartError: by more than `FAR_BEYOND`.
        """
        # Of these joints those that are far beyond.
        far = self._beyond(q) > FAR_BEYOND
        far &= np.isin(self.joint_names, list(joints))
        if far.any():
            raise StartError(
                "joint_states",
                [f"{name} = {value:.6g}" for name, value in self._those(q, far)],
                listed(self.limit_violations(np.where(far, q, self.lower)), "; ")
                + f", by more than {FAR_BEYOND:g}: publish rad or m",
            )

    def within_limits(self, q: Array, tolerance: float) -> Array:
        """A copy of q (nq,) in which what is beyond a limit by no more than that is at the limit.

        Args:
            tolerance: rad or m.
        """
        near = self._beyond(q) <= tolerance * (1.0 + 1e-9)
        return np.where(near & self._has_limits, np.clip(q, self.lower, self.upper), q)

    @property
    def _has_limits(self) -> npt.NDArray[np.bool_]:
        """(nq,) of joints with end stops; a mimicking one follows its master, whatever its own."""
        return ~np.isin(self.joint_names, [*self.continuous, *self.mimics])

    def _beyond(self, q: Array) -> Array:
        """(nq,) by how much each joint of q (nq,) is beyond its limits, rad or m; 0 inside."""
        beyond = np.maximum(np.maximum(self.lower - q, q - self.upper), 0.0)
        return np.where(self._has_limits, beyond, 0.0)

    def _those(self, q: Array, which: npt.NDArray[np.bool_]) -> list[tuple[str, float]]:
        return [(self.joint_names[i], float(q[i])) for i in np.flatnonzero(which)]

    def limit_violations(self, q: Array) -> list[str]:
        """One sentence per joint of q (nq,) that is beyond its limits."""
        return [
            f"joint {name} = {value:.6g} is beyond its limits [{self.lower[i]:.6g}, "
            f"{self.upper[i]:.6g}]"
            for i in np.flatnonzero(self._beyond(q) > LIMIT_TOLERANCE)
            for name, value in [(self.joint_names[i], q[i])]
        ]

    def has_link(self, name: str) -> bool:
        """Whether there is a link of that name."""
        return bool(self.model.existFrame(name, pin.FrameType.BODY))

    def frame_id(self, link: str) -> int:
        """Index of a link in model.frames.

        Raises:
            RobotError: no such link.
        """
        if not self.has_link(link):
            raise RobotError("link", link, f"name a link of the robot {self.name!r}")
        return int(self.model.getFrameId(link, pin.FrameType.BODY))

    def link_pose(self, q: Array, link: str) -> pin.SE3:
        """T_world_link at q (nq,), in the root link's frame.

        Raises:
            RobotError: no such link.
        """
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, q)
        return pin.SE3(data.oMf[self.frame_id(link)])

    def geometry_poses(self, q: Array) -> list[pin.SE3]:
        """T_world_geometry of each of geometry.geometryObjects at q (nq,), in the root link's
        frame.

        Pinocchio's own way makes what checks every collision pair first, which takes milliseconds.
        """
        data = self.model.createData()
        pin.forwardKinematics(self.model, data, q)
        return [data.oMi[joint] * T_joint_shape for joint, T_joint_shape in _shapes_of(self)]

    def joints_to(self, link: str) -> tuple[str, ...]:
        """Joints whose values the pose of a link depends on; none of them mimics another.

        Raises:
            RobotError: no such link.
        """
        chain = self._chain_joints(link)
        masters = (self.mimics[name].master if name in self.mimics else name for name in chain)
        return tuple(dict.fromkeys(masters))

    def carried(self, T: pin.SE3, frame: str) -> Robot:
        """This robot, all of it moved by T, in a frame of that name."""
        # What hangs on the root directly moves; all else with it.
        model, geometry = self.model.copy(), self.geometry.copy()
        for joint in range(1, model.njoints):
            if model.parents[joint] == 0:
                model.jointPlacements[joint] = T * model.jointPlacements[joint]
        for each in [*model.frames, *geometry.geometryObjects]:
            if each.parentJoint == 0 and each.name != "universe":
                each.placement = T * each.placement
        return replace(self, model=model, geometry=geometry, root_link=frame)

    def seen_from(self, frame: str) -> Robot:
        """This robot in the frame of one of its links.

        Raises:
            RobotError: no such link, or a joint moves it.
        """
        # A link that stands still.
        if not self.has_link(frame):
            words = (
                "is no link of the robot; name one, or add it by a fixed joint, or leave it empty"
            )
            raise RobotError("planning_frame", frame, words)
        link = self.model.frames[self.frame_id(frame)]
        if link.parentJoint != 0:
            raise RobotError(
                "planning_frame", frame, "moves; name a frame fixed to the robot's root"
            )
        return self.carried(link.placement.inverse(), frame)

    def arm(
        self,
        name: str,
        tip_frame: str,
        joints: Sequence[str] | None = None,
        grasps: Iterable[pin.SE3 | npt.ArrayLike] = (),
        touch_links: Sequence[str] | None = None,
        gripper_joints: Sequence[str] = (),
        gripper_open: Sequence[float] = (),
        also_touch: Sequence[str] = (),
    ) -> Arm:
        """An arm of this robot; what is None is derived.

        Args:
            name: for messages and results.
            tip_frame: link the grasps refer to.
            joints: root to tip; None: every movable joint between the root and the tip.
            grasps: T_tip_object, each a pose or (4, 4).
            touch_links: links that may touch the held object; None: the hand, that is, the tip
                link and all links it carries, or where these have no geometry, the next link
                towards the root that does, with all it carries.
            also_touch: more of them.
            gripper_joints, gripper_open: joints that open the hand, and their values when open.

        Raises:
            RobotError: unknown names, joints that do not lead to the tip, a chain with mimicking
                joints, values beyond limits.
            GraspError: a grasp is not a rigid transform.
        """
        where = f"arm {name}"
        if not isinstance(grasps, Iterable):
            raise GraspError(f"{where}: grasps", grasps, "give a list of poses")
        if not self.has_link(tip_frame):
            raise RobotError(
                f"{where}: tip_frame", tip_frame, f"name a link of the robot {self.name!r}"
            )
        # Joints on the way to the tip, in their order.
        chain = self._chain_joints(tip_frame)
        # Those chosen, if any are; each of them once.
        joints = chain if joints is None else tuple(joints)
        if not joints:
            raise RobotError(f"{where}: joints", [], f"no movable joint leads to {tip_frame}")
        for joint in joints:
            if joint not in chain:
                raise RobotError(
                    f"{where}: joints", joint, f"is not on the way to {tip_frame}: {list(chain)}"
                )
        if list(joints) != [joint for joint in chain if joint in joints]:
            ordered = [joint for joint in chain if joint in joints]
            raise RobotError(
                f"{where}: joints", list(joints), f"list each once, root to tip: {ordered}"
            )
        # What moves together, and what may touch.
        ties = self._ties(where, joints, chain)
        if touch_links is None:
            touch_links = self._hand_links(tip_frame)
        touch_links = tuple(dict.fromkeys([*touch_links, *also_touch]))
        for link in touch_links:
            if not self.has_link(link):
                raise RobotError(f"{where}: touch_links", link, "name a link of the robot")
        # The arm, with limits that fit each other.
        index, turnable = [self.index(joint) for joint in joints], self.turnable
        arm = Arm(
            name=name,
            tip_frame=tip_frame,
            joints=joints,
            grasps=tuple(_checked_grasp(g, f"{where}: grasps[{i}]") for i, g in enumerate(grasps)),
            touch_links=touch_links,
            gripper_joints=tuple(gripper_joints),
            gripper_open=self._checked_gripper(where, joints, gripper_joints, gripper_open),
            q_index=np.array(index),
            lower=self.lower[index],
            upper=self.upper[index],
            velocity=self.velocity_limits[index],
            acceleration=self.acceleration_limits[index],
            continuous=tuple(joint for joint in joints if joint in self.continuous),
            turnable=tuple(joint for joint in joints if joint in turnable),
            ties=ties,
        )
        return arm.with_limits(arm.lower, arm.upper)

    def _ties(self, where: str, joints: Sequence[str], chain: Sequence[str]) -> Array:
        """`Arm.ties` of these joints, of all joints on the way to the tip.

        Raises:
            RobotError: one of them moves with a joint that is not among them.
        """
        # A tie where both are joints of the arm; else neither may be.
        ties = []
        for follower, mimic in self.mimics.items():
            if follower in joints and mimic.master in joints:
                places = joints.index(follower), joints.index(mimic.master)
                ties.append((*places, mimic.multiplier, mimic.offset))
            elif follower in joints or (
                mimic.master in joints and (follower in chain or self._moves_shapes(follower))
            ):
                together = (f for f, each in self.mimics.items() if each.master == mimic.master)
                group = {mimic.master, *together}
                others = [joint for joint in joints if joint not in group]
                raise RobotError(
                    f"{where}: joints",
                    follower,
                    f"mimics {mimic.master}, and not both are joints of the arm: where they should "
                    f"stay where they are, leave out what moves together: {others}",
                )
        return np.array(ties, dtype=np.float64).reshape(-1, 4)

    def _moves_shapes(self, joint: str) -> bool:
        """Whether shapes hang on a joint."""
        below = set(self.model.subtrees[self.model.getJointId(joint)])
        return any(thing.parentJoint in below for thing in self.geometry.geometryObjects)

    def _filled(self, q: Array, positions: Mapping[str, float]) -> Array:
        # Finite numbers only, then what follows.
        bad = [
            f"{n} = {v!r}"
            for n, v in positions.items()
            if not (isinstance(v, Real) and math.isfinite(v))
        ]
        if bad:
            raise JointStateError("joint_states: values", bad, "must be finite numbers")
        for name, value in positions.items():
            q[self.index(name)] = value
        for name, mimic in self.mimics.items():
            q[self.index(name)] = mimic.multiplier * q[self.index(mimic.master)] + mimic.offset
        return q

    def _chain_joints(self, link: str) -> tuple[str, ...]:
        joint = self.model.frames[self.frame_id(link)].parentJoint
        names = []
        while joint != 0:
            names.append(str(self.model.names[joint]))
            joint = self.model.parents[joint]
        return tuple(reversed(names))

    def _carried_links(self, frame_id: int) -> tuple[str, ...]:
        """The link of a frame and every link it carries."""
        # Frames below it come after it.
        carried = {frame_id}
        for index, frame in enumerate(self.model.frames):
            if frame.parentFrame in carried and index != 0:
                carried.add(index)
        return tuple(
            str(self.model.frames[i].name)
            for i in sorted(carried)
            if self.model.frames[i].type == pin.FrameType.BODY
        )

    def _hand_links(self, tip_frame: str) -> tuple[str, ...]:
        frame_id = self.frame_id(tip_frame)
        # Up as long as nothing has geometry and no joint is passed.
        joint = self.model.frames[frame_id].parentJoint
        while True:
            links = self._carried_links(frame_id)
            above = self.model.frames[frame_id].parentFrame
            if set(links) & set(self.geometry_links) or (
                self.model.frames[above].parentJoint != joint
            ):
                return links
            frame_id = above

    def _checked_gripper(
        self,
        where: str,
        joints: Sequence[str],
        gripper_joints: Sequence[str],
        gripper_open: Sequence[float],
    ) -> tuple[float, ...]:
        if len(gripper_joints) != len(gripper_open):
            raise RobotError(
                f"{where}: gripper_open",
                list(gripper_open),
                f"give one value for each of gripper_joints {list(gripper_joints)}",
            )
        # Joints of the hand alone, within their limits.
        for joint, value in zip(gripper_joints, gripper_open, strict=True):
            field = f"{where}: gripper_joints"
            if joint not in self.joint_names:
                raise RobotError(field, joint, "name a movable joint of the robot")
            if joint in joints:
                raise RobotError(field, joint, "is a joint of the arm itself")
            if joint in self.mimics:
                raise RobotError(field, joint, f"follows {self.mimics[joint].master}; list that")
            low, high = self.lower[self.index(joint)], self.upper[self.index(joint)]
            if not low <= value <= high:
                raise RobotError(
                    f"{where}: gripper_open", value, f"must lie in {joint}'s [{low:g}, {high:g}]"
                )
        return tuple(float(v) for v in gripper_open)


@weak_lru_cache("robot", maxsize=1)
def _shapes_of(robot: Robot) -> list[tuple[int, pin.SE3]]:
    """Of each of geometry.geometryObjects the joint that carries it, and T_joint_geometry."""
    return [(g.parentJoint, pin.SE3(g.placement)) for g in robot.geometry.geometryObjects]


@lru_cache(maxsize=4)
def _near_pairs(robot: Robot) -> pairs.LinkPairs:
    given = robot.model, robot.geometry, robot.geometry_links, robot.covers
    return pairs.LinkPairs.that_are_checked(*given)


@lru_cache(maxsize=16)
def _without_pairs(robot: Robot, found: tuple[pairs.LeftOut, ...]) -> Robot:
    """The robot with these pairs left out too; the same one for the same pairs."""
    allowed = robot.allowed_pairs | {each.links for each in found}
    geometry = robot.geometry.copy()
    _add_collision_pairs(geometry, robot.geometry_links, allowed)
    known = robot.left_out or ()
    return replace(robot, geometry=geometry, allowed_pairs=allowed, left_out=(*known, *found))


def _said_of(left_out: tuple[pairs.LeftOut, ...]) -> list[str]:
    """What to say of pairs that were left out without an SRDF."""
    # Neighbours are counted, the others told one by one.
    hidden = [each for each in left_out if each.can_hide]
    plain = len(left_out) - len(hidden)
    words = f"no SRDF: {plain} pairs of neighbouring links are left out of self-collision checks"
    if not hidden:
        return [words]
    remedy = "give robot_description_semantic where these can really meet"
    return [f"{words}, and {len(hidden)} more; {remedy}", *(f"left out: {each}" for each in hidden)]


def _add_collision_pairs(
    geometry: pin.GeometryModel,
    geometry_links: tuple[str, ...],
    allowed: frozenset[pairs.Pair],
) -> None:
    """Pairs of objects on links that can move against each other and are not allowed to touch."""
    # Shapes on two joints, but for pairs that are allowed.
    joints = [thing.parentJoint for thing in geometry.geometryObjects]
    meet = np.zeros((len(joints), len(joints)), dtype=np.bool_)
    for i, j in itertools.combinations(range(len(joints)), 2):
        meet[i, j] = (
            joints[i] != joints[j]
            and pairs.sorted_pair(geometry_links[i], geometry_links[j]) not in allowed
        )
    # All at once: added one by one, each is compared with all before it.
    geometry.setCollisionPairs(meet)


def _checked_grasp(grasp: pin.SE3 | npt.ArrayLike, field: str) -> pin.SE3:
    try:
        # A rigid transform not far from the tip.
        T = np.array(grasp.homogeneous if isinstance(grasp, pin.SE3) else grasp, np.float64)
    except (TypeError, ValueError):
        T = np.empty(0)
    if T.shape != (4, 4):
        raise GraspError(field, grasp, "give T_tip_object, a pinocchio.SE3 or (4, 4)")
    R = T[:3, :3]
    if not np.isfinite(T).all():
        raise GraspError(field, T.tolist(), "every number must be finite")
    if np.abs(T[:3, 3]).max() > FAR_GRASP:
        raise GraspError(field, T[:3, 3].tolist(), f"is more than {FAR_GRASP:g} m from the tip")
    if np.abs(R.T @ R - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0.0:
        raise GraspError(field, R.tolist(), "is not a rotation; normalise the quaternion")
    if not np.array_equal(T[3], [0.0, 0.0, 0.0, 1.0]):
        raise GraspError(field, T.tolist(), "its last row must be 0 0 0 1; transpose it?")
    return pin.SE3(R, T[:3, 3])
