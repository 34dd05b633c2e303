"""Any URDF as one immutable value: kinematics, limits, collision geometry, arms."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, field, replace

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.covered_mesh import CoveredMesh, CoverMaker, kept_cover
from placement_planner_ros.core.errors import JointStateError, RobotError
from placement_planner_ros.core.robot import allowed_pairs as pairs
from placement_planner_ros.core.robot.arm import Arm
from placement_planner_ros.core.robot.arm_maker import derive_arm
from placement_planner_ros.core.robot.description import build_model, read_urdf
from placement_planner_ros.core.robot.geometry import MeshReader, PackageDirs, build_geometry
from placement_planner_ros.core.robot.joint_limits import JointLimit
from placement_planner_ros.core.robot.joint_space import JointSpace
from placement_planner_ros.core.types import Array
from placement_planner_ros.core.weak_cache import weak_lru_cache


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Robot(JointSpace):
    """A robot read from its URDF; never modified after construction.

    Its joints are those of a `JointSpace`.

    Attributes:
        name: of the robot.
        root_link: the frame in which everything is, by default the link that nothing carries.
        model: pinocchio model, nq == nv == len(joint_names).
        geometry: collision geometry; its collision pairs are those self-collision checks need.
        geometry_links: link of each of geometry.geometryObjects.
        meshes: of each of geometry.geometryObjects that is a mesh and not convex the mesh with its
            cover, the same for all with the same file and scale; of all others None.
        assumed: of each joint which limits nobody states, "velocity" or "acceleration".
        allowed_pairs: link pairs that self-collision checks leave out, sorted, and why.
        passive: joints that no motor drives, as the SRDF says.
        warnings: what was decided where the description was silent.
    """

    name: str
    root_link: str
    model: pin.Model
    geometry: pin.GeometryModel
    geometry_links: tuple[str, ...]
    meshes: tuple[CoveredMesh | None, ...]
    assumed: Mapping[str, tuple[str, ...]]
    allowed_pairs: Mapping[pairs.Pair, pairs.Reason] = field(default_factory=dict)
    passive: frozenset[str] = frozenset()
    warnings: tuple[str, ...] = ()

    @classmethod
    def from_urdf(
        cls,
        urdf_text: str,
        package_dirs: PackageDirs | MeshReader | None = None,
        srdf: str | None = None,
        joint_limits: Mapping[str, JointLimit] | None = None,
        cover: CoverMaker = kept_cover,
    ) -> Robot:
        """Read a robot.

        Args:
            urdf_text: the URDF itself, not a path.
            package_dirs: where `package://` URIs lead: package name -> share folder (or a folder
                that mesh paths are relative to), or what reads the mesh of a URI.
            srdf: text that lists disabled collisions; without it they are derived
                (`derive_allowed_pairs`).
            joint_limits: what else is stated of joints (`read_joint_limits`).
            cover: makes the cover of each of its meshes.

        Raises:
            RobotError: the description or its geometry is unusable; the message names the part.
        """
        # Kinematics, then geometry.
        root, movable, warnings = read_urdf(urdf_text, joint_limits)
        model = build_model(root)
        names = tuple(map(str, model.names[1:]))  # as coordinates are
        joints = {name: movable[name] for name in names}
        limits = np.array([astuple(joint.limit) for joint in joints.values()]).reshape(-1, 4)
        files = package_dirs or {}
        geometry, shape_links, meshes, notes = build_geometry(root, model, files, cover)
        links = tuple(f.name for f in model.frames if f.type == pin.FrameType.BODY)
        robot = cls(
            name=str(root.get("name")),
            root_link=links[0],
            model=model,
            geometry=geometry,
            geometry_links=shape_links,
            meshes=meshes,
            joint_names=names,
            lower=limits[:, 0],
            upper=limits[:, 1],
            velocity_limits=limits[:, 2],
            acceleration_limits=limits[:, 3],
            assumed={name: joint.assumed for name, joint in joints.items()},
            mimics={n: joint.mimic for n, joint in joints.items() if joint.mimic is not None},
            continuous=frozenset(name for name in names if joints[name].continuous),
            prismatic=frozenset(name for name in names if joints[name].prismatic),
        )
        # Pairs to leave out: of the SRDF, or derived; what is left is checked.
        if srdf is None:
            allowed, passive = pairs.derive_allowed_pairs(robot), robot.passive
            told = pairs.left_out_in_words(allowed)
        else:
            allowed, passive, told = pairs.read_srdf(srdf, links)
        checked = np.array([*pairs.shape_pairs(geometry, shape_links, allowed)], dtype=np.int64)
        meet = np.zeros((len(shape_links), len(shape_links)), dtype=np.bool_)
        meet[tuple(checked.reshape(-1, 2).T)] = True
        geometry.setCollisionPairs(meet)  # at once: one by one, each is compared with all before
        words = (*warnings, *notes, *told)
        return replace(robot, allowed_pairs=allowed, passive=passive, warnings=words)

    arm = derive_arm

    @property
    @weak_lru_cache("self", maxsize=1)
    def needed_joints(self) -> tuple[str, ...]:
        """Joints whose values must be known: all but those that mimic another, are passive, or move
        no shape."""
        movers = {joint for link in {*self.geometry_links} for joint in self.joints_to(link)}
        return tuple(name for name in self.joint_names if name in movers - self.passive)

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
            raise JointStateError("`q_start`: missing", missing, "give these joints too")
        # All that is given; the others at zero or the limit next to it.
        q = np.clip(np.zeros(len(self.joint_names)), self.lower, self.upper)
        return self.with_positions(q, {n: positions[n] for n in self.joint_names if n in positions})

    def with_open_hand(self, q: Array, arm: Arm) -> Array:
        """A copy of q (nq,) with the arm's gripper open."""
        return self.with_positions(q, dict(zip(arm.gripper_joints, arm.gripper_open, strict=True)))

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

    def geometry_poses(self, q: Array, data: pin.Data | None = None) -> list[pin.SE3]:
        """T_world_geometry of each of geometry.geometryObjects at q (nq,), in the root link's
        frame.

        Pinocchio's own way makes what checks every collision pair first, which takes milliseconds.

        Args:
            data: of the model, where many are asked for: of hundreds of joints it takes gigabytes.
        """
        data = data or self.model.createData()
        pin.forwardKinematics(self.model, data, q)
        return [data.oMi[s.parentJoint] * s.placement for s in self.geometry.geometryObjects]

    def joints_to(self, link: str) -> tuple[str, ...]:
        """Joints whose values the pose of a link depends on; none of them mimics another.

        Raises:
            RobotError: no such link.
        """
        of = {name: mimic.master for name, mimic in self.mimics.items()}
        return tuple(dict.fromkeys(of.get(name, name) for name in self.chain_joints(link)))

    def seen_from(self, frame: str) -> Robot:
        """This robot in the frame of one of its links.

        Raises:
            RobotError: no such link, or a joint moves it.
        """
        # A link that stands still.
        link = self.model.frames[self.frame_id(frame)] if self.has_link(frame) else None
        if link is None or link.parentJoint != 0:
            words = "is no link fixed to the robot's root; name one, add it by a fixed joint, or "
            raise RobotError("`root frame`", frame, f"{words}leave it empty")
        # What hangs on the root directly moves; all else with it.
        T, model, geometry = link.placement.inverse(), self.model.copy(), self.geometry.copy()
        for joint in range(1, model.njoints):
            if model.parents[joint] == 0:
                model.jointPlacements[joint] = T * model.jointPlacements[joint]
        for each in [*model.frames, *geometry.geometryObjects]:
            if each.parentJoint == 0 and each.name != "universe":
                each.placement = T * each.placement
        return replace(self, model=model, geometry=geometry, root_link=frame)

    def chain_joints(self, link: str) -> tuple[str, ...]:
        """Joints on the way from the root to a link, in their order; those that mimic, too."""
        joint = self.model.frames[self.frame_id(link)].parentJoint
        return tuple(str(self.model.names[each]) for each in self.model.supports[joint] if each)
