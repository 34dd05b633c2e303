"""The node's parameters: which settings of the planner users can set, and what ROS adds.

A parameter that is a setting needs one line here, in `PLANNER` or `GRID`: its default, words, unit
and range stand with the setting's field. Knows nothing of rclpy: `server.py` declares all this.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from placement_planner_ros.core.body.mesh import MAX_TRIANGLES
from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.objective.by_name import objective_names
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.robot.description import MAX_JOINTS, MAX_LINKS, MAX_TEXT
from placement_planner_ros.core.robot.joint_limits import FIELD
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.settings import FINITE, Meaning
from placement_planner_ros.core.types import MAX_BOXES
from placement_planner_ros.core.wishes import checks as wish_checks
from placement_planner_ros.ros.parameters import checks
from placement_planner_ros.ros.parameters.one_line import one_line
from placement_planner_ros.ros.parameters.spec import Check, Kind, Spec, Value, kind_of
from placement_planner_ros.scenes.scenes import CABINET_VOLUME
from placement_planner_ros.scenes.yumi import GRIPPER_JOINTS, GRIPPER_OPEN, TIP_FRAMES

PLANNER = {
    "sampler": "sampler",
    "local_optimization": "local_optimization",
    "collision_margin": "collision.collision_margin",
    "contact_tolerance": "collision.contact_tolerance",
    "support": "support",
    "support_margin": "support_margin",
    "edge_margin": "edge_margin",
    "support_region": "support_region",
    "approach_distance": "approach.approach_distance",
    "retreat_distance": "retreat.retreat_distance",
    "require_retreat": "require_retreat",
    "keep_out": "keep_out",
    "objective_terms": "wishes.terms",
    "objective_weights": "wishes.weights",
    "near_pose": "wishes.near_pose",
    "require_terms": "wishes.required",
    "require_at_least": "wishes.at_least",
    "velocity_scaling": "timing.velocity_scaling",
    "acceleration_scaling": "timing.acceleration_scaling",
    "acceleration_limits": "timing.acceleration_limits",
    "carry.max_tilt": "carry.max_tilt",
    "carry.max_acceleration": "carry.max_acceleration",
}
"""The parameters that are fields of PlannerSettings, and where they stand there."""
OBJECT_TURNS = {
    "object.up": "turns.up",
    "object.up_tolerance": "turns.up_tolerance",
    "object.front": "turns.front",
    "object.front_direction": "turns.front_direction",
    "object.front_tolerance": "turns.front_tolerance",
}
"""The same of how the object is turned, which stand with the object's."""
_CHECKS: dict[str, Check] = {
    "keep_out": wish_checks.boxes,
    "near_pose": wish_checks.pose,
    "object.up": wish_checks.direction,
    "object.front": wish_checks.direction,
    "objective_terms": checks.terms,
    "require_terms": checks.terms,
}
"""What else the values of settings must fulfil."""
GRID = {"cloud.cell_size": "cell_size"}
"""The parameters that are fields of GridSettings."""
REGIONS = {"max_slope": "max_slope"}
"""The parameters that are fields of RegionSettings."""
BODY = {"object.flatness": "flatness", "object.allow_rolling": "allow_rolling"}
"""The parameters that are fields of BodySettings."""
GONE = {"selection": "is gone; use sampler: optimistic or mcts"}
"""Parameters of former versions, and what to use instead."""

JOINT_LIMITS = f"{FIELD}.joint_limits."
"""How the names of limits begin that MoveIt's launch files give one by one."""
_LIMITS = {
    "has_position_limits",
    "min_position",
    "max_position",
    "has_velocity_limits",
    "max_velocity",
    "has_acceleration_limits",
    "max_acceleration",
}

_MAX_SEED = 2**63 - 1


def fixed_specs() -> list[Spec]:
    """Every parameter whose name does not depend on another's value."""
    planner, grid, body = PlannerSettings(), GridSettings(), BodySettings()
    regions = RegionSettings()
    return [
        *_start_up(),
        *_runs(),
        *(Spec.of(name, planner, path, _CHECKS.get(name)) for name, path in PLANNER.items()),
        *(Spec.of(name, regions, path) for name, path in REGIONS.items()),
        *_robot(),
        *_environment(),
        *(Spec.of(name, grid, path) for name, path in GRID.items()),
        *_object(),
        *(Spec.of(name, body, path) for name, path in BODY.items()),
        *(Spec.of(name, planner, path, _CHECKS.get(name)) for name, path in OBJECT_TURNS.items()),
    ]


def _own(
    name: str,
    default: Value,
    text: str,
    unit: str = "",
    interval: str = FINITE,
    *,
    choices: tuple[str, ...] = (),
    kind: Kind | None = None,
    length: int = -1,
    startup: bool = False,
    check: Check | None = None,
    tidy: Callable[[str], str] | None = None,
) -> Spec:
    """A parameter of ROS' own; where its default does not show its type, `kind` does."""
    meaning = Meaning(text, unit, interval, choices)
    return Spec(name, kind or kind_of(default), default, meaning, length, startup, check, tidy)


def _start_up() -> list[Spec]:
    return [
        _own(
            "robot_description",
            "",
            "URDF text, a path or a package:// URI; empty: the topic robot_description, "
            f"and the bundled YuMi until one arrives there. At most {MAX_LINKS} links, "
            f"{MAX_JOINTS} movable joints and {MAX_TEXT // 1_000_000} MB.",
            startup=True,
            tidy=one_line,
        ),
        _own(
            "robot_description_semantic",
            "",
            "SRDF text, a path or a package:// URI: link pairs that self-collision checks "
            "leave out. Optional.",
            startup=True,
            tidy=one_line,
        ),
        _own(
            FIELD,
            "",
            "Path or package:// URI of MoveIt's joint_limits.yaml: acceleration limits, and ranges "
            "and velocity limits where they are narrower than the URDF's. Optional.",
            startup=True,
        ),
        _own(
            "planning_frame",
            "",
            "Frame of target_volume and of all results, z up: a link fixed to the root, or one "
            "that tf2 knows, looked up at each start; empty: the robot's root link.",
            startup=True,
        ),
        _own(
            "package_paths",
            [],
            "Folders in which package:// names are looked up, besides the ament index and the "
            "folders above the URDF file.",
            kind="string[]",
            startup=True,
        ),
        _own(
            "file_roots",
            [],
            "Folders from which files may be read that are named later, or in a description that "
            "came by topic, besides package_paths and the ament index.",
            kind="string[]",
            startup=True,
        ),
        _own(
            "cloud_topics",
            [],
            "Topics with clouds of the environment, besides points.",
            kind="string[]",
            startup=True,
        ),
        _own(
            "sensor_frames",
            [],
            "Frames that are a sensor's eye, besides optical frames of organised clouds: lines of "
            "sight begin at their origin. Their poses may be given as sensor_poses.<frame>.",
            kind="string[]",
            startup=True,
            check=checks.names,
        ),
        _own(
            "frame_prefix",
            "",
            "What robot_state_publisher puts before the names of links, as its own frame_prefix: "
            "stripped from frames of clouds, known objects and tf.",
            startup=True,
        ),
    ]


def _runs() -> list[Spec]:
    volume = [*map(float, CABINET_VOLUME.lower), *map(float, CABINET_VOLUME.upper)]
    return [
        _own(
            "target_volume",
            volume,
            "Minimum and maximum corner of the target volume V in planning_frame; or those of "
            f"several boxes, one after the other, up to {MAX_BOXES}: V is their union. The object "
            "comes to stand on a surface in it, with its centre of mass above or below V's floor "
            "area, in any of the boxes; the rest of it may reach beyond.",
            "m",
            check=checks.volume,
        ),
        _own(
            "objective",
            "maximize_clearance",
            "What to maximise: maximize_clearance, minimize_clearance, weighted (the sum of "
            "objective_terms), or the name of an entry point in the group "
            "placement_planner_ros.objectives.",
            choices=tuple(objective_names()),
        ),
        _own(
            "time_limit",
            30.0,
            "Time after which a run ends, by a steady clock; 0: it runs until stopped.",
            "s",
            "[0, 1e6]",
        ),
        _own(
            "seed",
            -1,
            "Seed of every random choice of a run; -1: from the machine's entropy.",
            "",
            f"[-1, {_MAX_SEED}]",
        ),
    ]


def _robot() -> list[Spec]:
    return [
        _own(
            "trajectory_joints",
            "arm",
            "Which joints trajectories name: the arm's, or all with the others held.",
            choices=("arm", "all"),
        ),
        _own(
            "start_tolerance",
            0.02,
            "A robot further from where a run began ends that run.",
            "rad or m",
            "[0.0001, 1]",
        ),
        _own(
            "start_limit_tolerance",
            0.001,
            "Joints beyond a limit by no more than this are taken to be at the limit, and that is "
            "told; a joint of an arm that is further beyond is BAD_START.",
            "rad or m",
            "[0, 0.05]",
        ),
        _own(
            "rest_speed",
            0.02,
            "A joint of an arm, or on the way to a sensor, that is faster than this by its "
            "positions, over 0.3 s, is moving.",
            "rad/s or m/s",
            "[0.0001, 1]",
        ),
        _own(
            "assumed_joints",
            [],
            "Values joint=value, rad or m, of joints that nobody publishes. Joints that move no "
            "shape, and passive ones of the SRDF, need none.",
            kind="string[]",
            check=checks.joint_values,
        ),
        _own(
            "world_links",
            [],
            "Links of the robot's description that are furniture, obstacle and support, instead of "
            "those found: links that no joint moves, but for the robot's foot.",
            kind="string[]",
        ),
        _own(
            "joint_state_timeout",
            1.0,
            "Joint values older than this are stale.",
            "s",
            "[0.01, 3600]",
        ),
    ]


def _environment() -> list[Spec]:
    return [
        _own(
            "cloud.mode",
            "latest",
            "latest: the newest cloud of each topic; merge: all clouds since clear_environment.",
            choices=("latest", "merge"),
        ),
        _own(
            "cloud.max_age",
            60.0,
            "In mode latest, clouds older than this are stale; 0: any age will do.",
            "s",
            "[0, 1e6]",
        ),
        _own(
            "unknown_space",
            "free",
            "What no sensor has seen, by the lines of sight of clouds in their sensor's frame: "
            "free, or occupied, so that nothing enters it, or occupied_below: occupied, but free "
            "above the highest thing measured.",
            choices=("free", "occupied", "occupied_below"),
        ),
        _own(
            "clearance.beyond_volume",
            True,
            "Whether things up to 0.5 m outside V count for clearance; false: only those in V, the "
            "paper's definition.",
        ),
        _own(
            "mesh_tolerance",
            0.002,
            "What is farther from a mesh than its margin and this is never called colliding. "
            "Answers rest on the original triangles, so they keep to any value.",
            "m",
            "[0.0001, 0.05]",
        ),
        _own(
            "self_filter.enabled",
            True,
            "Whether points on the robot and on the held object are left out of clouds.",
        ),
        _own(
            "self_filter.padding",
            0.02,
            "Points this close to the surface of the robot or of the held object carry nothing. "
            "Those that lie on it are left out; the others are obstacles to whatever moves.",
            "m",
            "[0, 0.2]",
        ),
        _own(
            "self_filter.padding_of",
            [],
            "Links with a padding of their own, each as link=metres, up to 0.2 m.",
            kind="string[]",
            check=checks.paddings,
        ),
    ]


def _object() -> list[Spec]:
    return [
        _own(
            "object.mesh",
            "",
            "Mesh file of the grasped object, a path or a package:// URI, of at most "
            f"{MAX_TRIANGLES} triangles.",
        ),
        _own(
            "object.vertices",
            [],
            "Vertices of the grasped object: x y z, one after the other.",
            "m",
            kind="double[]",
            check=checks.triples,
        ),
        _own(
            "object.triangles",
            [],
            f"Triangles of the grasped object: three vertex indices each, {MAX_TRIANGLES} at most.",
            "",
            "[0, inf)",
            kind="integer[]",
            check=checks.triples,
        ),
        _own(
            "object.center_of_mass",
            [],
            "Centre of mass in the mesh's frame and unit; empty: from the mesh.",
            kind="double[]",
            check=checks.center,
        ),
        _own("object.scale", 1.0, "Factor from the mesh's unit to metres.", "", "(0, 1e6]"),
    ]


def arms_spec(default: Sequence[str]) -> Spec:
    """The parameter `arms`; at start-up it also says for which arms parameters exist."""
    return _own(
        "arms",
        list(default),
        "Arms that could be holding the object, by name.",
        kind="string[]",
        check=checks.names,
    )


def arm_specs(arm: str, *, yumi: bool) -> list[Spec]:
    """Parameters of one arm; `yumi` chooses the bundled robot's values as defaults."""
    known = yumi and arm in TIP_FRAMES
    return [
        _own(
            f"{arm}.tip_frame",
            TIP_FRAMES[arm] if known else "",
            "Link that the arm's grasps refer to.",
        ),
        _own(
            f"{arm}.joints",
            [],
            "The arm's joints, root to tip; empty: every movable joint on the way to the tip.",
            kind="string[]",
        ),
        _own(
            f"{arm}.grasps",
            [],
            "Poses of the object in the tip frame: x y z qx qy qz qw, one after the other, "
            f"{checks.MAX_GRASPS} at most.",
            "m",
            kind="double[]",
            check=checks.grasps,
        ),
        _own(
            f"{arm}.touch_links",
            [],
            "Links that may touch the held object besides the hand's own, which the URDF shows.",
            kind="string[]",
        ),
        _own(
            f"{arm}.gripper_joints",
            [GRIPPER_JOINTS[arm]] if known else [],
            "Joints that open the hand.",
            kind="string[]",
        ),
        _own(
            f"{arm}.gripper_open",
            [GRIPPER_OPEN] if known else [],
            "Values of gripper_joints when the hand is open.",
            "rad or m",
            kind="double[]",
        ),
    ]


def joint_limit_spec(name: str) -> Spec | None:
    """One limit of MoveIt's that was given as a parameter of its own, by its whole name.

    None where it is of a kind that nothing is done with, as jerk.
    """
    what = name.rpartition(".")[2]
    if not name.startswith(JOINT_LIMITS) or what not in _LIMITS:
        return None
    default: Value = True if what.startswith("has_") else 1.0
    return _own(name, default, "One of MoveIt's joint limits.", startup=True)


def sensor_pose_spec(frame: str) -> Spec:
    """Pose of one declared sensor frame."""
    return _own(
        f"sensor_poses.{frame}",
        [],
        "Pose of the frame in planning_frame: x y z qx qy qz qw; empty: not given. At a start the "
        "newest cloud goes there too, but for points accumulated with cloud.mode merge.",
        "m",
        kind="double[]",
        check=checks.one_pose,
    )
