"""Arms of three to five joints at a table, all made of boxes, with an object in hand."""

import numpy as np
import pinocchio as pin
import trimesh
from checker import Task

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import Objective, ObjectiveContext
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.environment import Environment
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.primitives import box, standing_box
from placement_planner_ros.scenes.scenes import Scene

SIZE = np.array([0.05, 0.05, 0.12])
"""m, of the object: a box."""
FROM_ASIDE = pin.SE3(np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), np.zeros(3))
FROM_ABOVE = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 0.03]))
"""T_tip_object: the object upright where the hand points ahead, and where it points down."""
ARMS = ("five", "five aside", "four", "four aside", "scara", "gantry", "gantry yaw", "telescope")
"""Of how many joints; those aside move in a plane that does not hold the axis of the base."""
_ASIDE = 0.05
"""m"""
_CLOSED, _OPEN = 0.0245, 0.045
"""m, of each finger."""
_GREY = (0.5, 0.5, 0.5)

_LINK = """
  <link name="{}"><collision><origin xyz="{}"/>
    <geometry><box size="{}"/></geometry></collision></link>"""
_JOINT = """
  <joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><origin xyz="{}" rpy="{}"/>
    <axis xyz="{}"/><limit lower="{}" upper="{}" velocity="2" effort="9"/></joint>"""
_HAND = (
    _LINK.format("hand", "0.03 0 0", "0.05 0.11 0.03")
    + '<link name="tip"/>'
    + _LINK.format("left", "0.03 0.006 0", "0.06 0.01 0.02")
    + _LINK.format("right", "0.03 -0.006 0", "0.06 0.01 0.02")
    + _JOINT.format("to_tip", "fixed", "hand", "tip", "0.1 0 0", "0 1.5708 0", "0 0 1", 0, 0)
    + _JOINT.format("finger", "prismatic", "hand", "left", "0.06 0 0", "0 0 0", "0 1 0", 0, _OPEN)
    + _JOINT.format(
        "finger_2", "prismatic", "hand", "right", "0.06 0 0", "0 0 0", "0 -1 0", 0, _OPEN
    ).replace("<limit", '<mimic joint="finger"/><limit')
)


def _pitching(roll: bool, aside: float) -> str:
    """A base that turns, three joints about one horizontal direction, and a hand that may roll."""
    links = [
        _LINK.format("base", "0 0 0.1", "0.1 0.1 0.2"),
        _LINK.format("column", "0 0 0.04", "0.06 0.06 0.08"),
        _LINK.format("upper", "0.125 0 0", "0.25 0.04 0.05"),
        _LINK.format("fore", "0.11 0 0", "0.2 0.035 0.04"),
        _LINK.format("wrist", "0.025 0 0", "0.05 0.035 0.03"),
    ]
    kind, above = "revolute" if roll else "fixed", f"0.02 {aside} 0.12"
    joints = [
        ("turn", "revolute", "base", "column", "0 0 0.21", "0 0 0", "0 0 1", -3, 3),
        ("pitch_1", "revolute", "column", "upper", above, "0 0 0", "0 1 0", -2.6, 2.6),
        ("pitch_2", "revolute", "upper", "fore", "0.27 0 0", "0 0 0", "0 1 0", -2.6, 2.6),
        ("pitch_3", "revolute", "fore", "wrist", "0.24 0 0", "0 0 0", "0 1 0", -2.6, 2.6),
        ("roll", kind, "wrist", "hand", "0.07 0 0", "0 0 0", "1 0 0", -3, 3),
    ]
    return "".join(links) + "".join(_JOINT.format(*joint) for joint in joints)


def _scara() -> str:
    """Two joints about upright axes, a quill that goes up and down and turns."""
    links = [
        _LINK.format("base", "0 0 0.25", "0.1 0.1 0.5"),
        _LINK.format("upper", "0.15 0 0.03", "0.3 0.06 0.05"),
        _LINK.format("fore", "0.13 0 0.03", "0.26 0.05 0.05"),
        _LINK.format("quill", "0 0 0", "0.03 0.03 0.3"),
    ]
    joints = [
        ("turn", "revolute", "base", "upper", "0 0 0.51", "0 0 0", "0 0 1", -2.8, 2.8),
        ("elbow", "revolute", "upper", "fore", "0.3 0 0.06", "0 0 0", "0 0 1", -2.6, 2.6),
        ("lift", "prismatic", "fore", "quill", "0.29 0 0.05", "0 0 0", "0 0 -1", 0, 0.25),
        ("roll", "revolute", "quill", "hand", "0 0 -0.16", "0 1.5708 0", "1 0 0", -3, 3),
    ]
    return "".join(links) + "".join(_JOINT.format(*joint) for joint in joints)


def _gantry(yaw: bool) -> str:
    """A bridge on rails of 12 m, a cart on it, and a mast that may turn its hand."""
    links = [
        _LINK.format("base", "0 1 1.5", "12.4 0.1 0.1"),
        _LINK.format("bridge", "0 0 0.1", "0.1 2.2 0.1"),
        _LINK.format("cart", "0 0 0.1", "0.12 0.12 0.06"),
        _LINK.format("mast", "0 0 0.4", "0.05 0.05 0.8"),
    ]
    kind = "revolute" if yaw else "fixed"
    joints = [
        ("rail", "prismatic", "base", "bridge", "0 0 1.5", "0 0 0", "1 0 0", -6, 6),
        ("across", "prismatic", "bridge", "cart", "0 0 0.1", "0 0 0", "0 1 0", -0.9, 0.9),
        ("down", "prismatic", "cart", "mast", "0.1 0 -0.7", "0 0 0", "0 0 -1", 0, 0.7),
        ("roll", kind, "mast", "hand", "0 0 -0.01", "0 1.5708 0", "1 0 0", -3, 3),
    ]
    return "".join(links) + "".join(_JOINT.format(*joint) for joint in joints)


def _telescope() -> str:
    """A mast that turns, a lift, an arm of four sections that slide out together, a wrist."""
    links = [
        _LINK.format("base", "0 0 0.05", "0.2 0.2 0.1"),
        _LINK.format("mast", "-0.06 0 0.45", "0.05 0.05 0.9"),
        _LINK.format("carriage", "0 0 0", "0.06 0.06 0.06"),
        *(_LINK.format(f"section_{k}", "0 0 0", "0.1 0.04 0.04") for k in range(4)),
        _LINK.format("yawing", "0 0 -0.03", "0.03 0.03 0.03"),
        _LINK.format("pitching", "0 0 0", "0.02 0.02 0.02"),
    ]
    kind, at, turned, axis, low, high = "prismatic", "0.035 0 0", "0 0 0", "1 0 0", 0.0, 0.13
    follow = '<mimic joint="slide_0"/>', '<mimic joint="slide_0" multiplier=".9" offset=".005"/>'
    joints = [
        _JOINT.format("turn", "revolute", "base", "mast", "0 0 0.11", turned, "0 0 1", -3, 3),
        _JOINT.format("lift", "prismatic", "mast", "carriage", at, turned, "0 0 1", 0.05, 0.85),
    ]
    for k in range(4):
        below = f"section_{k - 1}" if k else "carriage"
        made = _JOINT.format(f"slide_{k}", kind, below, f"section_{k}", at, turned, axis, low, high)
        joints.append(made.replace("<limit", f"{follow[k % 2]}<limit") if k else made)
    for name, below, above, at, axis in (
        ("yaw", "section_3", "yawing", "0.06 0 -0.03", "0 0 1"),
        ("pitch", "yawing", "pitching", "0 0 -0.07", "0 1 0"),
        ("roll", "pitching", "hand", "0.04 0 0", "1 0 0"),
    ):
        joints.append(_JOINT.format(name, "revolute", below, above, at, turned, axis, -3, 3))
    return "".join(links) + "".join(joints)


def urdf_of(name: str) -> str:
    """One of `ARMS`."""
    aside = _ASIDE if name.endswith("aside") else 0.0
    if name == "telescope":
        body = _telescope()
    elif name.startswith("gantry"):
        body = _gantry(yaw=name.endswith("yaw"))
    else:
        body = _scara() if name == "scara" else _pitching(name.startswith("five"), aside)
    return f'<robot name="{name.replace(" ", "_")}">{body}{_HAND}</robot>'


def start_of(name: str) -> dict[str, float]:
    """The object upright above the table, held from aside; by the SCARA, from above."""
    if name == "telescope":
        return {"lift": 0.5, "slide_0": 0.05, "finger": _CLOSED}
    if name.startswith("gantry"):
        return {"rail": 0.5, "across": 0.0, "down": 0.1, "finger": _CLOSED}
    if name == "scara":
        return {"turn": -0.8, "elbow": 1.2, "lift": 0.0, "finger": _CLOSED}
    return {"pitch_1": -0.9, "pitch_2": 1.9, "pitch_3": -1.0, "finger": _CLOSED}


def table() -> Scene:
    """A table with three things, its surface at z = 0.1 m."""
    volume = TargetVolume([0.28, -0.4, 0.08], [0.62, 0.4, 0.3])
    things = [((0.08, 0.05, 0.09), (0.42, 0.1)), ((0.05, 0.05, 0.12), (0.36, -0.22))]
    parts = [box("table", (0.22, -0.45, 0.06), (0.7, 0.45, 0.1), _GREY)]
    for k, (size, centre) in enumerate(things):
        parts.append(standing_box(f"thing_{k}", size, centre, 0.4 * k, 0.1, _GREY))
    return Scene("table", volume, tuple(parts))


def environment_of(scene: Scene) -> Environment:
    """Of its complete cloud."""
    lower, upper = scene.volume.lower - 0.2, scene.volume.upper + 0.2
    return Environment.from_points(
        complete_cloud(scene),
        scene.volume,
        bounds=(np.minimum(lower, -0.2), np.maximum(upper, 0.8)),
    )


def body() -> Body:
    """The object."""
    mesh = trimesh.creation.box(SIZE)
    return Body.from_mesh(mesh.vertices, mesh.faces)


def made(
    name: str, grasp: pin.SE3, scene: Scene, environment: Environment
) -> tuple[Problem, Objective, Task]:
    """The task of one of `ARMS` that holds the object so."""
    text = urdf_of(name)
    robot = Robot.from_urdf(text)
    free = [joint for joint in robot.joint_names if joint not in robot.mimics]
    start = dict.fromkeys(free, 0.0) | start_of(name)
    arm = robot.arm("arm", "tip", grasps=[grasp], gripper_joints=("finger",), gripper_open=(_OPEN,))
    held = body()
    mesh = trimesh.creation.box(SIZE)
    problem = Problem(robot, (arm,), robot.configuration(start), held, scene.volume, environment)
    objective = make_objective(
        "maximize_clearance", ObjectiveContext(environment, scene.volume, held)
    )
    measured = environment.measured
    pairs = "".join(
        f'<disable_collisions link1="{a}" link2="{b}"/>' for a, b in robot.allowed_pairs
    )
    task = Task(
        scene.parts,
        scene.volume.boxes[:, 0],
        scene.volume.boxes[:, 1],
        np.asarray(mesh.vertices),
        np.asarray(mesh.faces),
        held.center_of_mass,
        text,
        f"<robot>{pairs}</robot>",
        {},
        start,
        "none",
        np.array([measured.lower, measured.upper]),
    )
    return problem, objective, task
