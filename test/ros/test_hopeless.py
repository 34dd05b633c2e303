"""Hopeless situations made on purpose: the code, the remedy named, and that the remedy helps."""

import math
import re
import threading
import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import rclpy
from helpers.fakes import FRAME, Bench
from helpers.home import HOME
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.yumi import TIP_FRAMES, load_yumi

SAMPLES = 6000
"""After which a search that finds nothing is given up."""


def level(x, y, z, step=0.006):
    """Points of a level rectangle from x[0] to x[1] and y[0] to y[1] at height z."""
    grid = np.meshgrid(np.arange(*x, step), np.arange(*y, step), z)
    return np.stack(grid, axis=-1).reshape(-1, 3)


TABLE = level((0.2, 0.6), (-0.3, 0.4), 0.0)
ABOVE = [0.25, -0.1, -0.05, 0.55, 0.3, 0.2]
"""A target_volume that holds most of the table's surface."""


def hand():
    """Points within the left hand."""
    robot = load_yumi()
    x, y, z = robot.link_pose(robot.configuration(HOME), TIP_FRAMES["left"]).translation
    return level((x - 0.02, x + 0.02), (y - 0.02, y + 0.02), z)


def poses(*grasps):
    return [float(v) for grasp in grasps for v in pin.SE3ToXYZQUAT(grasp)]


def pose(T):
    return [float(v) for v in pin.SE3ToXYZQUAT(T)]


def turned(about, angle, x=0.0, y=0.0, z=0.0):
    return pin.SE3(pin.exp3(angle * np.asarray(about, dtype=float)), np.array([x, y, z]))


def block(length, width, height):
    """Parameters of a block."""
    corners = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T
    corners = corners * (length, width, height)
    faces = [0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6]
    faces += [0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3]
    return {"object.vertices": corners.ravel().tolist(), "object.triangles": faces}


# --- the situations


@dataclass(frozen=True)
class Inputs:
    """What the node is given: parameters, points in a frame, and joint values."""

    parameters: dict[str, Any] = field(default_factory=dict)
    points: np.ndarray = field(default_factory=lambda: TABLE)
    frame: str = FRAME
    joints: dict[str, float] = field(default_factory=dict)

    def but(self, **parameters):
        """The same with some parameters changed."""
        changed = {name.replace("__", "."): value for name, value in parameters.items()}
        return replace(self, parameters={**self.parameters, **changed})


def number(pattern, words):
    """The number that the words give there."""
    return float(re.search(pattern, words).group(1))


def lowered(inputs, words):
    volume = [*inputs.parameters["target_volume"]]
    volume[2] = number(r"set its minimum z to (-?[\d.]+)", words)
    return inputs.but(target_volume=volume)


def raised(inputs, words):
    volume = [*inputs.parameters["target_volume"]]
    volume[5] = number(r"set its maximum z to (-?[\d.]+)", words)
    return inputs.but(target_volume=volume)


def untilted(inputs, words):
    """The sensor's pose turned by what the words say."""
    angle = np.radians(number(r"correct the sensor's tilt by ([\d.]+) degrees", words))
    x, y = (number(rf"rising towards .*{axis} = (-?[\d.]+)", words) for axis in "xy")
    return inputs.but(sensor_poses__camera=pose(turned((-y, x, 0.0), angle)))


def with_parameters(**parameters):
    return lambda inputs, _: inputs.but(**parameters)


@dataclass(frozen=True)
class Situation:
    """A hopeless one, the code and remedy that the node is to name, and what applies it."""

    inputs: Inputs
    code: str
    remedy: str
    cure: Any
    says: str = ""


HELD = object_by_name("small_crayons_box")
SIDEWAYS = turned((0, 1, 0), np.pi / 2, z=0.215)
FROM_ABOVE = turned((0, 0, 1), 0.0, z=0.145)
PLATE = block(0.14, 0.14, 0.01)
BELOW = np.array([0.4, 0.0, -0.4])
"""Where a camera sees the table from below."""


def along_x(y):
    """A wall."""
    return level((0.3, 0.55), (0.0, 0.055), y, 0.004)[:, [0, 2, 1]]


TRENCH = np.concatenate([TABLE, along_x(0.113), along_x(0.187)])
"""Two walls between which the fingers fit, but not once they have opened."""

SITUATIONS = {
    "volume in the air": Situation(
        Inputs({"target_volume": [0.25, -0.1, 0.1, 0.55, 0.3, 0.3]}),
        "NO_REGION",
        "target_volume",
        lowered,
        "0.100 m under it",
    ),
    "volume under the table": Situation(
        Inputs({"target_volume": [0.25, -0.1, -0.3, 0.55, 0.3, -0.1]}),
        "NO_REGION",
        "target_volume",
        raised,
        "0.100 m above it",
    ),
    "object larger than any region": Situation(
        Inputs(
            {"target_volume": [0.3, 0.0, 0.05, 0.55, 0.2, 0.3]},
            np.concatenate([TABLE, level((0.4, 0.43), (0.1, 0.13), 0.1, 0.004)]),
        ),
        "UNSUPPORTED",
        "target_volume",
        with_parameters(target_volume=ABOVE),
        "the largest 0.0008 m²",
    ),
    "out of reach": Situation(
        Inputs(
            {"target_volume": [1.4, -0.1, -0.05, 1.7, 0.3, 0.2]},
            level((0.2, 1.8), (-0.3, 0.4), 0.0),
        ),
        "OUT_OF_REACH",
        "target_volume",
        with_parameters(target_volume=ABOVE),
        "out of reach of every arm",
    ),
    "ceiling too low": Situation(
        Inputs(
            {"target_volume": [0.25, -0.3, -0.05, 0.55, 0.0, 0.02]},
            np.concatenate([TABLE, level((0.2, 0.6), (-0.4, 0.02), 0.0325)]),
        ),
        "NO_SOLUTION",
        "target_volume",
        with_parameters(target_volume=[0.25, 0.1, -0.05, 0.55, 0.4, 0.02]),
        "let the object meet something",
    ),
    "a grasp that always collides": Situation(
        # Far from the table's ends, beside which the hand may be lower.
        Inputs(
            {
                **PLATE,
                "left.grasps": poses(SIDEWAYS),
                "target_volume": [0.36, 0.0, -0.05, 0.46, 0.2, 0.2],
            }
        ),
        "NO_SOLUTION",
        "left.grasps",
        with_parameters(left__grasps=poses(FROM_ABOVE)),
        "had arm, hand or object in collision",
    ),
    "start in self-collision": Situation(
        Inputs({"arms": ["left", "right"]}, joints=dict.fromkeys(HOME, 0.0)),
        "BAD_START",
        "joint_states",
        lambda inputs, _: replace(inputs, joints={}),
        "in self-collision",
    ),
    "start in collision with the cloud": Situation(
        Inputs({"self_filter.enabled": False}, np.concatenate([TABLE, hand()])),
        "BAD_START",
        "self_filter.enabled",
        with_parameters(self_filter__enabled=True),
        "in collision with the surroundings",
    ),
    "an empty cloud": Situation(
        Inputs(points=np.zeros((0, 3))),
        "NO_CLOUD",
        "cloud_topics",
        lambda inputs, _: replace(inputs, points=TABLE),
        "every cloud is empty",
    ),
    "a frame that nobody knows": Situation(
        Inputs(points=TABLE, frame="camera"),
        "CLOUD_FRAME",
        "sensor_poses.camera",
        with_parameters(sensor_poses__camera=pose(pin.SE3.Identity())),
        "'camera'",
    ),
    "everything unseen": Situation(
        Inputs(
            {"sensor_poses.camera": pose(pin.SE3(np.eye(3), BELOW)), "unknown_space": "occupied"},
            TABLE - BELOW,
            "camera",
        ),
        "NO_SOLUTION",
        "unknown_space",
        with_parameters(unknown_space="free"),
        "23% of target_volume have been seen",
    ),
    "tilted too far": Situation(
        Inputs(
            {"sensor_poses.camera": pose(pin.SE3.Identity())},
            TABLE @ pin.exp3(np.array([0.1, -0.15, 0.0])).T,
            "camera",
        ),
        "NO_REGION",
        "sensor_poses.camera",
        untilted,
        "slopes by 10.",
    ),
    "a surface full of holes": Situation(
        Inputs(points=TABLE[np.random.default_rng(0).random(len(TABLE)) < 0.07]),
        "NO_REGION",
        "cloud_topics",
        lambda inputs, _: replace(inputs, points=TABLE),
        "nothing in target_volume was found to be level, measured without holes",
    ),
    "a volume narrower than any region": Situation(
        Inputs({"target_volume": [0.4, 0.1, -0.05, 0.41, 0.11, 0.2]}),
        "NO_REGION",
        "target_volume",
        with_parameters(target_volume=ABOVE),
        "larger than 1 cm²",
    ),
    "a cloud in millimetres": Situation(
        Inputs(points=1000.0 * TABLE),
        "NO_REGION",
        "cloud_topics",
        lambda inputs, _: replace(inputs, points=inputs.points / 1000.0),
        "taken to be metres",
    ),
    "a margin too wide for the hand": Situation(
        Inputs({"collision_margin": 0.1}),
        "NO_SOLUTION",
        "collision_margin",
        with_parameters(collision_margin=0.003),
        "0.1 m is set",
    ),
    "an object in millimetres": Situation(
        Inputs({"object.scale": 1000.0}),
        "BAD_OBJECT",
        "object.scale",
        with_parameters(object__scale=1.0),
        "m across",
    ),
    "a trench too narrow to open the hand": Situation(
        Inputs(
            {
                "target_volume": [0.33, 0.14, -0.05, 0.52, 0.16, 0.02],
                "left.grasps": poses(HELD.grasps["left"][1]),
            },
            TRENCH,
        ),
        "NO_SOLUTION",
        "left.gripper_open",
        with_parameters(left__gripper_open=[0.0205]),
        "left the fingers no room to open",
    ),
    "an edge margin too wide": Situation(
        Inputs(
            {"edge_margin": 0.06, "target_volume": [0.3, 0.05, -0.05, 0.5, 0.25, 0.15]},
            level((0.335, 0.465), (0.085, 0.215), 0.0),
        ),
        "UNSUPPORTED",
        "edge_margin",
        with_parameters(edge_margin=0.003),
        "0.06 m is set, 0.003 m is usual",
    ),
    "a side up that no rest has": Situation(
        Inputs({"object.up": [0.3, 0.5, 1.0], "object.up_tolerance": 0.05}),
        "NO_FACE",
        "object.up",
        with_parameters(object__up=[]),
        "keeps object.up",
    ),
    "a front that is upright where the other side is up": Situation(
        Inputs({"object.up": [0.0, 0.0, 1.0], "object.front": [0.0, 0.0, 1.0]}),
        "NO_FACE",
        "object.front",
        with_parameters(object__front=[]),
        "keeps object.up and object.front",
    ),
    "no time": Situation(
        Inputs({"time_limit": 1e-5}),
        "NO_SOLUTION",
        "time_limit",
        with_parameters(time_limit=0.0),
        "no sample was tried",
    ),
}


# --- how they are tried


@pytest.fixture(scope="module")
def bench():
    """One node with its own planner, for all situations."""
    rclpy.init()
    made = RealBench(sensor_frames=["camera"])
    yield made
    made.close()
    rclpy.try_shutdown()


class RealBench(Bench):
    """The node with its own planner, which pauses after so many samples until it is stopped."""

    most = SAMPLES

    def _prepare(self, snapshot, should_stop):
        planner = self.node._preparation.prepare(snapshot, should_stop)
        most, self.paused = self.most, threading.Event()
        run = planner.run

        def limited(should_stop):
            yield from run(lambda: should_stop() or planner.statistics.samples >= most)
            if planner.statistics.samples >= most:
                self.paused.set()
            while not (planner.exhausted or should_stop()):
                time.sleep(0.002)

        planner.run = limited
        return planner

    def give(self, inputs):
        """Set all parameters and hand over the messages, as the executor would."""
        parameters = {**BASE, **inputs.parameters}
        results = self.node.set_parameters([Parameter(n, value=v) for n, v in parameters.items()])
        assert all(result.successful for result in results), results
        self.node._inputs.object.wait()
        values = {**HOME, **inputs.joints}
        self.node._reception._take_joint_states(
            JointState(name=list(values), position=[float(v) for v in values.values()])
        )
        message = message_from_points(inputs.points, Header(frame_id=inputs.frame))
        self.node._reception._take_cloud("points", message)

    def tried(self, inputs):
        """Code and words of a run that ends by itself, finds something, or has paused."""
        self.give(inputs)
        answers = [self.call("start")]
        while answers[-1].code == "ROBOT_MOVING":  # it moved to where these inputs have it
            self.give(inputs)
            answers.append(self.call("start"))
        answer = answers[-1]
        if not answer.success:
            return answer.code, answer.words
        run = self.node._commands.run
        self.wait(lambda: not run.active or run.solutions or (run.planner and self.paused.is_set()))
        self.call("stop")
        self.wait(lambda: not run.active)
        answer = self.call("stop")
        self.wait(lambda: self.status()["state"] == run.state)
        return self.status()["code"], answer.words


BASE = {
    "target_volume": ABOVE,
    "arms": ["left"],
    "left.grasps": poses(*HELD.grasps["left"]),
    "left.gripper_open": [0.025],
    "right.grasps": poses(*HELD.grasps["right"]),
    "object.vertices": HELD.vertices.ravel().tolist(),
    "object.triangles": HELD.triangles.ravel().tolist(),
    "object.scale": 1.0,
    "object.up": [],
    "object.up_tolerance": 0.17,
    "object.front": [],
    "edge_margin": 0.003,
    "sensor_poses.camera": [],
    "unknown_space": "free",
    "self_filter.enabled": True,
    "cloud.cell_size": 0.01,
    "cloud.max_age": 0.0,
    "collision_margin": 0.003,
    "joint_state_timeout": 3600.0,
    "retreat_distance": 0.1,
    "seed": 1,
    "time_limit": 0.0,
}
"""What every situation begins with."""


def remedies(words):
    """The parameters that are named in a run's words as something to try."""
    named = re.findall(r"(?:; try|; or) ([\w.<>, ]+):", words.splitlines()[0])
    return [name for names in named for name in names.split(", ")]


@pytest.mark.parametrize("name", SITUATIONS)
def test_it_is_told_why_nothing_was_found_and_the_remedy_helps(bench, name):
    situation = SITUATIONS[name]
    bench.most = SAMPLES
    code, words = bench.tried(situation.inputs)
    assert (code, situation.says in words) == (situation.code, True), words
    refused = code in ("BAD_START", "BAD_GRASP", "BAD_OBJECT", "NO_CLOUD", "CLOUD_FRAME")
    assert situation.remedy in (words if refused else remedies(words)), words
    assert refused or all(map(bench.node.has_parameter, remedies(words))), words
    bench.most = math.inf
    code, words = bench.tried(situation.cure(situation.inputs, words))
    assert code == "OK", words
    assert bench.node._commands.run.solutions
