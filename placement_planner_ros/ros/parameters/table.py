"""The node's parameters: which settings of the planner users can set, and what ROS adds.

A parameter that is a setting needs one line here, in `PLANNER` or `GRID`: its default, words, unit
and range stand with the setting's field. Knows nothing of rclpy: `server.py` declares all this.
"""

from __future__ import annotations

from collections.abc import Sequence

from placement_planner_ros.core.objective.objective import objective_names
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.settings import Meaning
from placement_planner_ros.ros.parameters import checks
from placement_planner_ros.ros.parameters.spec import Spec
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import GRIPPER_JOINTS, GRIPPER_OPEN, TIP_FRAMES

PLANNER = {
    "sampler": "sampler",
    "local_optimization": "local_optimization",
    "collision_margin": "collision.collision_margin",
    "contact_tolerance": "collision.contact_tolerance",
    "approach_distance": "approach.approach_distance",
    "retreat_distance": "retreat.retreat_distance",
    "require_retreat": "require_retreat",
    "velocity_scaling": "execution.velocity_scaling",
    "acceleration_scaling": "execution.acceleration_scaling",
    "acceleration_limits": "execution.acceleration_limits",
}
"""The parameters that are fields of PlannerSettings, and where they stand there."""
GRID = {"cloud.cell_size": "cell_size"}
"""The parameters that are fields of GridSettings."""
GONE = {"selection": "is gone; use sampler: optimistic or mcts"}
"""Parameters of former versions, and what to use instead."""

_SCENE = scene_by_name("cabinet_high_clutter")
_MAX_SEED = 2**63 - 1


def fixed_specs() -> list[Spec]:
    """Every parameter whose name does not depend on another's value."""
    planner, grid = PlannerSettings(), GridSettings()
    return [
        *_start_up(),
        *_runs(),
        *(Spec.of(name, planner, path) for name, path in PLANNER.items()),
        *_robot(),
        *_environment(),
        *(Spec.of(name, grid, path) for name, path in GRID.items()),
        *_object(),
    ]


def _start_up() -> list[Spec]:
    return [
        Spec(
            "robot_description",
            "string",
            "",
            Meaning(
                "URDF text, a path or a package:// URI; empty: the topic robot_description, "
                "and the bundled YuMi until one arrives there."
            ),
            startup=True,
        ),
        Spec(
            "robot_description_semantic",
            "string",
            "",
            Meaning(
                "SRDF text, a path or a package:// URI: link pairs that self-collision checks "
                "leave out. Optional."
            ),
            startup=True,
        ),
        Spec(
            "planning_frame",
            "string",
            "",
            Meaning(
                "Frame of target_volume and of all results, z up; empty: the robot's root link."
            ),
            startup=True,
        ),
        Spec(
            "cloud_topics",
            "string[]",
            [],
            Meaning("Topics with clouds of the environment, besides points."),
            startup=True,
        ),
        Spec(
            "sensor_frames",
            "string[]",
            [],
            Meaning("Frames of clouds whose poses are given as sensor_poses.<frame>."),
            startup=True,
            check=checks.names,
        ),
    ]


def _runs() -> list[Spec]:
    volume = [*map(float, _SCENE.volume.lower), *map(float, _SCENE.volume.upper)]
    return [
        Spec(
            "target_volume",
            "double[]",
            volume,
            Meaning("Minimum and maximum corner of the target volume V in planning_frame.", "m"),
            length=6,
            check=checks.volume,
        ),
        Spec(
            "objective",
            "string",
            "maximize_clearance",
            Meaning(
                "What to maximise: maximize_clearance, minimize_clearance, or the name of an entry "
                "point in the group placement_planner_ros.objectives.",
                choices=tuple(objective_names()),
            ),
        ),
        Spec(
            "time_limit",
            "double",
            30.0,
            Meaning(
                "Time after which a run ends, by a steady clock; 0: it runs until stopped.",
                "s",
                "[0, 1e6]",
            ),
        ),
        Spec(
            "seed",
            "integer",
            -1,
            Meaning(
                "Seed of every random choice of a run; -1: from the machine's entropy.",
                "",
                f"[-1, {_MAX_SEED}]",
            ),
        ),
    ]


def _robot() -> list[Spec]:
    return [
        Spec(
            "trajectory_joints",
            "string",
            "arm",
            Meaning(
                "Which joints trajectories name: the arm's, or all with the others held.",
                choices=("arm", "all"),
            ),
        ),
        Spec(
            "start_tolerance",
            "double",
            0.02,
            Meaning(
                "A robot further from where a run began ends that run.", "rad or m", "[0.0001, 1]"
            ),
        ),
        Spec(
            "joint_state_timeout",
            "double",
            1.0,
            Meaning("Joint values older than this are stale.", "s", "[0.01, 3600]"),
        ),
    ]


def _environment() -> list[Spec]:
    return [
        Spec(
            "cloud.mode",
            "string",
            "latest",
            Meaning(
                "latest: the newest cloud of each topic; merge: all clouds since "
                "clear_environment.",
                choices=("latest", "merge"),
            ),
        ),
        Spec(
            "cloud.max_age",
            "double",
            60.0,
            Meaning(
                "In mode latest, clouds older than this are stale; 0: any age will do.",
                "s",
                "[0, 1e6]",
            ),
        ),
        Spec(
            "unknown_space",
            "string",
            "free",
            Meaning(
                "What no sensor has seen, by the lines of sight of clouds in their sensor's frame: "
                "free, or occupied, so that nothing enters it.",
                choices=("free", "occupied"),
            ),
        ),
        Spec(
            "self_filter.enabled",
            "bool",
            True,
            Meaning("Whether points on the robot and on the held object are left out of clouds."),
        ),
        Spec(
            "self_filter.padding",
            "double",
            0.02,
            Meaning(
                "Points this close to the robot or the held object are left out.", "m", "[0, 0.2]"
            ),
        ),
    ]


def _object() -> list[Spec]:
    return [
        Spec(
            "object.mesh",
            "string",
            "",
            Meaning("Mesh file of the grasped object, a path or a package:// URI."),
        ),
        Spec(
            "object.vertices",
            "double[]",
            [],
            Meaning("Vertices of the grasped object: x y z, one after the other.", "m"),
            check=checks.triples,
        ),
        Spec(
            "object.triangles",
            "integer[]",
            [],
            Meaning("Triangles of the grasped object: three vertex indices each.", "", "[0, inf)"),
            check=checks.triples,
        ),
        Spec(
            "object.center_of_mass",
            "double[]",
            [],
            Meaning("Centre of mass in the mesh's frame and unit; empty: from the mesh."),
            check=checks.center,
        ),
        Spec(
            "object.scale",
            "double",
            1.0,
            Meaning("Factor from the mesh's unit to metres.", "", "(0, 1e6]"),
        ),
    ]


def arms_spec(default: Sequence[str]) -> Spec:
    """The parameter `arms`; at start-up it also says for which arms parameters exist."""
    return Spec(
        "arms",
        "string[]",
        list(default),
        Meaning("Arms that could be holding the object, by name."),
        check=checks.names,
    )


def arm_specs(arm: str, *, yumi: bool) -> list[Spec]:
    """Parameters of one arm; `yumi` chooses the bundled robot's values as defaults."""
    known = yumi and arm in TIP_FRAMES
    return [
        Spec(
            f"{arm}.tip_frame",
            "string",
            TIP_FRAMES[arm] if known else "",
            Meaning("Link that the arm's grasps refer to."),
        ),
        Spec(
            f"{arm}.joints",
            "string[]",
            [],
            Meaning(
                "The arm's joints, root to tip; empty: every movable joint on the way to the tip."
            ),
        ),
        Spec(
            f"{arm}.grasps",
            "double[]",
            [],
            Meaning(
                "Poses of the object in the tip frame: x y z qx qy qz qw, one after the other.", "m"
            ),
            check=checks.poses,
        ),
        Spec(
            f"{arm}.touch_links",
            "string[]",
            [],
            Meaning("Links that may touch the held object; empty: the hand's, from the URDF."),
        ),
        Spec(
            f"{arm}.gripper_joints",
            "string[]",
            [GRIPPER_JOINTS[arm]] if known else [],
            Meaning("Joints that open the hand."),
        ),
        Spec(
            f"{arm}.gripper_open",
            "double[]",
            [GRIPPER_OPEN] if known else [],
            Meaning("Values of gripper_joints when the hand is open.", "rad or m"),
        ),
    ]


def sensor_pose_spec(frame: str) -> Spec:
    """Pose of one declared sensor frame."""
    return Spec(
        f"sensor_poses.{frame}",
        "double[]",
        [],
        Meaning("Pose of the frame in planning_frame: x y z qx qy qz qw; empty: not given.", "m"),
        check=checks.one_pose,
    )
