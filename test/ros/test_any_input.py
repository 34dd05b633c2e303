"""Whatever is set, called or published: every call is answered with a code, and the node plans on.

EXAMPLES=2000 tries other inputs each time, and more of them.
"""

import math
import os
import re

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from helpers.fakes import FRAME, TABLE, Bench
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointField
from std_msgs.msg import Header

from placement_planner_ros.ros.inputs.point_cloud import message_from_points

CODES = re.findall(
    r"\w+",
    "OK ALREADY_RUNNING NOT_RUNNING STOPPING WRONG_RUN NO_CLOUD CLOUD_STALE CLOUD_FRAME "
    "JOINTS_MISSING JOINTS_STALE ROBOT_MOVING NO_OBJECT BAD_OBJECT BAD_GRASP BAD_VOLUME "
    "BAD_PARAMETER BAD_ROBOT BAD_START NOT_READY",
)
"""INTERNAL, a fault of the node's own, is none of them."""

# What overflows is a fault: it ends in a log that nobody reads, and in a search that finds nothing.
pytestmark = pytest.mark.filterwarnings("error::RuntimeWarning")

often = settings(
    max_examples=int(os.environ.get("EXAMPLES", "60")),
    deadline=None,
    derandomize="EXAMPLES" not in os.environ,
    database=None,
    suppress_health_check=list(HealthCheck),
)

ODD = (0.0, -0.0, 1.0, -1.0, 1e-320, 1e9, 1e300, -1e300, math.inf, -math.inf, math.nan)
NUMBERS = st.sampled_from(ODD) | st.floats(-10.0, 10.0)
UINT32 = st.integers(0, 2**32 - 1) | st.integers(0, 40)
WORDS = ["", " ", "left", "right", FRAME, "map", "~/x.stl", "package://a/b", "1e-05"]
LETTERS = st.characters(exclude_categories=["Cs"], exclude_characters="\0")
TEXTS = st.sampled_from(WORDS) | st.text(LETTERS, max_size=30)
STAMPS = st.builds(Time, sec=st.integers(-(2**31), 2**31 - 1), nanosec=UINT32)


class World:
    """A node that has all it needs, and whatever else a test gives it."""

    def __init__(self):
        self.bench = Bench(sensor_frames=["eye"])
        node = self.bench.node
        self.specs = node._settings.current.specs
        self.at_first = [
            node.get_parameter(name)
            for name, spec in self.specs.items()
            if not spec.startup and name not in ("object.vertices", "object.triangles")
        ]
        self.body = [node.get_parameter(f"object.{part}") for part in ("vertices", "triangles")]
        self.names = sorted(self.specs)
        self.clients = {}

    def request(self, kind, service, parameters):
        client = self.bench.client
        if service not in self.clients:
            self.clients[service] = client.create_client(kind, f"placement_planner/{service}")
            assert self.clients[service].wait_for_service(30.0)
        future = self.clients[service].call_async(kind.Request(parameters=parameters))
        self.bench.wait(future.done)
        return future.result()

    def answered(self, text):
        """The code of an answer; a run it began is ended."""
        code = text.split()[0].removeprefix("code=")
        assert code in CODES, text
        if code == "OK":
            ended = {self.bench.call("stop").code}
            # STOPPING: the worker had no time to look, on a busy machine
            self.bench.wait(lambda: self.bench.call("stop").code == "NOT_RUNNING")
            assert ended <= {"OK", "NOT_RUNNING", "STOPPING"}
        return code

    def see_the_table(self):
        """A cloud that is as it should be."""
        message = message_from_points(TABLE, Header(frame_id=FRAME))
        self.bench.node._reception._take_cloud("points", message)

    def still_plans(self):
        """Give everything as at first; then a run must start."""
        b = self.bench
        assert b.node.set_parameters_atomically(self.at_first).successful
        assert b.node.set_parameters_atomically(self.body).successful

        def start():
            self.see_the_table()
            b.joint_state()
            return self.answered(b.call("start").text) == "OK"

        b.wait(start)


@pytest.fixture(scope="module")
def world():
    rclpy.init()
    made = World()
    made.still_plans()
    yield made
    made.bench.close()
    rclpy.try_shutdown()


@st.composite
def values(draw, spec=None):
    """A value of any type; of the parameter's own, with some numbers or names exchanged."""
    if spec is not None and draw(st.integers(0, 5)) > 0:
        value, kind = spec.default, spec.kind.removesuffix("[]")
        odd = values_of(kind)
        if not isinstance(value, list):
            value = draw(st.sampled_from([value, *spec.meaning.choices]) | odd)
        elif draw(st.booleans()):
            value = draw(st.lists(odd, max_size=8))
        elif value:
            value = list(value)
            value[draw(st.integers(0, len(value) - 1))] = draw(odd)
        kinds = {"bool": "BOOL", "integer": "INTEGER", "double": "DOUBLE", "string": "STRING"}
        kind = kinds[spec.kind.removesuffix("[]")] + ("_ARRAY" if spec.kind[-1] == "]" else "")
        return Parameter("x", Parameter.Type[kind], value).get_parameter_value()
    return ParameterValue(
        type=draw(st.integers(0, 9) | st.integers(0, 255)),
        bool_value=draw(st.booleans()),
        integer_value=draw(st.integers(-(2**63), 2**63 - 1)),
        double_value=draw(NUMBERS),
        string_value=draw(TEXTS),
        integer_array_value=draw(st.lists(st.integers(-(2**63), 2**63 - 1), max_size=9)),
        double_array_value=draw(st.lists(NUMBERS, max_size=15)),
        string_array_value=draw(st.lists(TEXTS, max_size=5)),
    )


def values_of(kind):
    return {
        "bool": st.booleans(),
        "integer": st.integers(-5, 20) | st.sampled_from([2**63 - 1, -(2**63)]),
        "double": st.floats(0.001, 2.0) | NUMBERS,
        "string": TEXTS,
    }[kind]


@st.composite
def parameters(draw, specs):
    """Some parameters, most of them of the node's, perhaps one twice."""
    made = []
    for _ in range(draw(st.integers(0, 3))):
        name = draw(st.sampled_from(sorted(specs)))
        if draw(st.integers(0, 9)) == 0:
            name = draw(TEXTS)
        made.append(ParameterMessage(name=name, value=draw(values(specs.get(name)))))
    return made


@often
@given(st.data())
def test_any_parameters_of_a_run(world, data):
    given_ = data.draw(parameters(world.specs))
    world.bench.joint_state()
    response = world.request(SetParametersAtomically, "start_with", given_)
    code = world.answered(response.result.reason)
    assert response.result.successful == (code == "OK")


@often
@given(st.data())
def test_any_parameters_that_are_set(world, data):
    given_ = data.draw(parameters(world.specs))
    results = world.request(SetParameters, "set_parameters", given_).results
    assert len(results) == len(given_)
    assert all(each.successful or each.reason for each in results)
    assert all("INTERNAL" not in each.reason for each in results)
    world.see_the_table()
    world.bench.joint_state()
    world.answered(world.bench.call("start").text)


ODD_PART = {
    "name": st.sampled_from(["x", "y", "z", "rgb", ""]),
    "offset": UINT32,
    "datatype": st.sampled_from([7, 8]) | st.integers(0, 255),
    "count": UINT32,
}
ODD_SIZE = {
    "height": UINT32,
    "width": UINT32,
    "point_step": UINT32,
    "row_step": UINT32,
    "is_bigendian": st.booleans(),
    "data": st.binary(max_size=400),
    "fields": st.lists(st.builds(PointField, **ODD_PART), max_size=4),
}


@st.composite
def clouds(draw):
    """A cloud of which a few parts do not fit the rest."""
    points = draw(st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), max_size=30))
    with np.errstate(over="ignore"):
        message = message_from_points(np.reshape(np.array(points), (-1, 3)), Header())
    for _ in range(draw(st.integers(0, 3))):
        if message.fields and draw(st.booleans()):
            part = draw(st.sampled_from(sorted(ODD_PART)))
            setattr(draw(st.sampled_from(list(message.fields))), part, draw(ODD_PART[part]))
        else:
            part = draw(st.sampled_from(sorted(ODD_SIZE)))
            setattr(message, part, draw(ODD_SIZE[part]))
    message.header = Header(
        stamp=draw(st.just(Time()) | STAMPS),
        frame_id=draw(st.sampled_from([FRAME] * 5 + ["eye", "gripper_l_base"]) | TEXTS),
    )
    return message


@often
@given(clouds(), st.sampled_from(["latest", "merge"]))
def test_any_cloud(world, message, mode):
    b = world.bench
    assert b.node.set_parameters([Parameter("cloud.mode", value=mode)])[0].successful
    b.joint_state()
    b.node._reception._take_cloud("points", message)
    world.answered(b.call("start").text)


def test_after_all_of_that_it_plans(world):
    assert world.bench.call("clear_environment").code == "OK"
    world.still_plans()
