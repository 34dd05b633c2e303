"""The node's parameters: which settings of the planner users can set, and what ROS adds.

A setting needs one line, in `node_words.SETTINGS`: its default, words, unit and range stand with
the setting's field. Knows nothing of rclpy: `server.py` declares all this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.objective.by_name import objective_names
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.settings import Settings
from placement_planner_ros.core.wishes import checks as wish_checks
from placement_planner_ros.ros.node_words import SETTINGS
from placement_planner_ros.ros.parameters import checks
from placement_planner_ros.ros.parameters.spec import Check, Spec, Value, own_spec
from placement_planner_ros.scenes.scenes import CABINET_VOLUME
from placement_planner_ros.scenes.yumi import GRIPPER_JOINTS, GRIPPER_OPEN, TIP_FRAMES

KINDS: dict[str, type[Settings]] = {
    "planner_settings": PlannerSettings,
    "grid_settings": GridSettings,
    "region_settings": RegionSettings,
    "body_settings": BodySettings,
}
"""The settings that parameters make, by the attribute of a `ParameterSet`."""
_CHECKS: dict[str, Check] = {
    "keep_out": wish_checks.check_boxes,
    "near_pose": wish_checks.check_pose_value,
    "object.up": wish_checks.check_direction,
    "object.front": wish_checks.check_direction,
    "objective_terms": checks.known_terms,
    "require_terms": checks.known_terms,
}
"""What else the values of settings must fulfil."""


# fmt: off
_OWN = (
    own_spec("robot_description", "string", "",
             "URDF text, a path or a package:// URI; empty: the topic robot_description, and the "
             "bundled YuMi until one arrives there.", startup=True),
    own_spec("robot_description_semantic", "string", "",
             "SRDF text, a path or a package:// URI: link pairs that self-collision checks leave "
             "out. Optional.", startup=True),
    own_spec("robot_description_planning", "string", "",
             "Path or package:// URI of MoveIt's joint_limits.yaml: acceleration limits, and "
             "ranges and velocity limits where they are narrower than the URDF's. Optional.",
             startup=True),
    own_spec("planning_frame", "string", "",
             "Frame of target_volume and of all results, z up: a link fixed to the root; empty: "
             "the robot's root link.", startup=True),
    own_spec("package_paths", "string[]", [],
             "Folders in which package:// names are looked up, besides the ament index and the "
             "folders above the URDF file.", startup=True),
    own_spec("file_roots", "string[]", [],
             "Folders from which files may be read that are named later, or in a description that "
             "came by topic, besides package_paths and the ament index.", startup=True),
    own_spec("cloud_topics", "string[]", [],
             "Topics of clouds that each run needs; points is optional then.", startup=True),
    own_spec("sensor_frames", "string[]", [],
             "Frames that are a sensor's eye, besides optical frames of organised clouds: lines of "
             "sight begin at their origin. Their poses may be given as sensor_poses.<frame>.",
             checks.distinct_names, startup=True),
    own_spec("frame_prefix", "string", "",
             "What robot_state_publisher puts before the names of links, as its own frame_prefix: "
             "stripped from frames of clouds, known objects and tf.", startup=True),

    own_spec("target_volume", "double[]", [*map(float, CABINET_VOLUME.boxes.ravel())],
             "Minimum and maximum corner of the target volume V in planning_frame; or those of "
             "several boxes, one after the other, up to 64: V is their union. The object comes to "
             "stand on a surface in it, with its centre of mass above or below V's floor area, in "
             "any of the boxes; the rest of it may reach beyond.",
             unit="m", check=checks.volume_boxes),
    own_spec("objective", "string", "maximize_clearance",
             "What to maximise: maximize_clearance, minimize_clearance, weighted (the sum of "
             "objective_terms), or the name of an entry point in the group "
             "placement_planner_ros.objectives.", choices=tuple(objective_names())),
    own_spec("time_limit", "double", 30.0,
             "Time after which a run ends, by a steady clock; 0: it runs until stopped.",
             interval="[0, 1e6]", unit="s"),
    own_spec("seed", "integer", -1,
             "Seed of every random choice of a run; -1: from the machine's entropy.",
             interval=f"[-1, {2**63 - 1}]"),

    own_spec("trajectory_joints", "string", "arm",
             "Which joints trajectories name: the arm's, or all with the others held.",
             choices=("arm", "all")),
    own_spec("start_tolerance", "double", 0.02,
             "A robot further from where a run began ends that run.", interval="[0.0001, 1]",
             unit="rad or m"),
    own_spec("start_limit_tolerance", "double", 0.001,
             "Joints beyond a limit by no more than this are taken to be at the limit, and that is "
             "told; a joint of an arm that is further beyond is BAD_START.",
             interval="[0, 0.05]", unit="rad or m"),
    own_spec("rest_speed", "double", 0.02,
             "A joint of an arm, or on the way to a sensor, that is faster than this by its "
             "positions, over 0.3 s, is moving.", interval="[0.0001, 1]", unit="rad/s or m/s"),
    own_spec("assumed_joints", "string[]", [],
             "Values joint=value, rad or m, of joints that nobody publishes. Joints that move no "
             "shape, and passive ones of the SRDF, need none.", check=checks.named_numbers),
    own_spec("world_links", "string[]", [],
             "Links of the robot's description that are furniture, obstacle and support, instead "
             "of those found: links that no joint moves, but for the robot's foot."),
    own_spec("joint_state_timeout", "double", 1.0, "Joint values older than this are stale.",
             interval="[0.01, 3600]", unit="s"),

    own_spec("cloud.mode", "string", "latest",
             "latest: the newest cloud of each topic; merge: all clouds since clear_environment.",
             choices=("latest", "merge")),
    own_spec("cloud.max_age", "double", 60.0,
             "In mode latest, clouds older than this are stale; 0: any age will do.",
             interval="[0, 1e6]", unit="s"),
    own_spec("unknown_space", "string", "free",
             "What no sensor has seen, by the lines of sight of clouds in their sensor's frame: "
             "free, or occupied, so that nothing enters it, or occupied_below: occupied, but free "
             "above the highest thing measured.", choices=("free", "occupied", "occupied_below")),
    own_spec("clearance.beyond_volume", "bool", True,
             "Whether things up to 0.5 m outside V count for clearance; false: only those in V, "
             "the paper's definition."),
    own_spec("mesh_tolerance", "double", 0.002,
             "What is farther from a mesh than its margin and this is never called colliding. "
             "Answers rest on the original triangles, so they keep to any value.",
             interval="[0.0001, 0.05]", unit="m"),
    own_spec("self_filter.enabled", "bool", True,
             "Whether points on the robot and on the held object are left out of clouds."),
    own_spec("self_filter.padding", "double", 0.02,
             "Points this close to the surface of the robot or of the held object carry nothing. "
             "Those that lie on it are left out; the others are obstacles to whatever moves.",
             interval="[0, 0.2]", unit="m"),
    own_spec("self_filter.padding_of", "string[]", [],
             "Links with a padding of their own, each as link=metres, up to 0.2 m.",
             check=checks.paddings_by_link),

    own_spec("object.mesh", "string", "",
             "Mesh file of the grasped object, a path or a package:// URI, of at most 300000 "
             "triangles."),
    own_spec("object.vertices", "double[]", [],
             "Vertices of the grasped object: x y z, one after the other.",
             unit="m", check=checks.triples),
    own_spec("object.triangles", "integer[]", [],
             "Triangles of the grasped object: three vertex indices each, 300000 at most.",
             interval="[0, inf)", check=checks.triples),
    own_spec("object.center_of_mass", "double[]", [],
             "Centre of mass in the mesh's frame and unit; empty: from the mesh.",
             check=checks.point_or_nothing),
    own_spec("object.scale", "double", 1.0, "Factor from the mesh's unit to metres.",
             interval="(0, 1e6]"),
)
"""The parameters of ROS' own whose names do not depend on another's value."""

_ARM = (
    own_spec("tip_frame", "string", "", "Link that the arm's grasps refer to."),
    own_spec("joints", "string[]", [],
             "The arm's joints, root to tip; empty: every movable joint on the way to the tip."),
    own_spec("grasps", "double[]", [],
             "Poses of the object in the tip frame: x y z qx qy qz qw, one after the other, 200 at "
             "most.", unit="m", check=checks.grasp_poses),
    own_spec("touch_links", "string[]", [],
             "Links that may touch the held object besides the hand's own, which the URDF shows."),
    own_spec("gripper_joints", "string[]", [], "Joints that open the hand."),
    own_spec("gripper_open", "double[]", [], "Values of gripper_joints when the hand is open.",
             unit="rad or m"),
)
"""Of each of them, after its name."""
# fmt: on


def fixed_specs() -> list[Spec]:
    """Every parameter whose name does not depend on another's value."""
    settings = [
        Spec.of(name, kind(), path, _CHECKS.get(name))
        for group, kind in KINDS.items()
        for name, path in SETTINGS[group].items()
    ]
    return [*_OWN, *settings]


def arms_spec(default: Sequence[str]) -> Spec:
    """The parameter `arms`; at start-up it also says for which arms parameters exist."""
    text = "Arms that could be holding the object, by name."
    return own_spec("arms", "string[]", [*default], text, checks.distinct_names)


def arm_specs(arm: str, *, yumi: bool) -> list[Spec]:
    """Parameters of one arm; `yumi` chooses the bundled robot's values as defaults."""
    known: dict[str, Value] = {}
    if yumi and arm in TIP_FRAMES:
        known |= {"tip_frame": TIP_FRAMES[arm], "gripper_joints": [GRIPPER_JOINTS[arm]]}
        known["gripper_open"] = [GRIPPER_OPEN]
    return [
        replace(spec, name=f"{arm}.{spec.name}", default=known.get(spec.name, spec.default))
        for spec in _ARM
    ]


def sensor_pose_spec(frame: str) -> Spec:
    """Pose of one declared sensor frame."""
    text = (
        "Pose of the frame in planning_frame: x y z qx qy qz qw; empty: not given. At a start the "
        "newest cloud goes there too, but for points accumulated with cloud.mode merge."
    )
    name, check = f"sensor_poses.{frame}", wish_checks.check_pose_value
    return own_spec(name, "double[]", [], text, check, unit="m")
