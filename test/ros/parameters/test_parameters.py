import runpy
from array import array
from pathlib import Path

import numpy as np
import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from placement_planner_ros.core.errors import GraspError, ObjectError, ParameterError, VolumeError
from placement_planner_ros.ros.node_words import in_node_words
from placement_planner_ros.ros.parameters.server import ParameterServer
from placement_planner_ros.ros.parameters.table import arm_specs, arms_spec, fixed_specs
from placement_planner_ros.ros.parameters.values import ParameterSet

SPECS = {s.name: s for s in [*fixed_specs(), arms_spec(["left"]), *arm_specs("left", yumi=True)]}


def parameter_set(**values):
    return ParameterSet(SPECS, {name.replace("__", "."): v for name, v in values.items()})


def test_every_default_is_accepted_by_its_own_checks():
    for spec in SPECS.values():
        assert spec.convert(spec.default) == spec.default


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        ("time_limit", "soon", ParameterError),
        ("support", "hull", ParameterError),
        ("time_limit", float("nan"), ParameterError),
        ("target_volume", [1.0, 0.0, 0.0, 0.0, 1.0, 1.0], VolumeError),
        ("target_volume", [0.0, 0.0, 0.0, 1.0, 1.0, float("inf")], ParameterError),
        ("seed", 1.5, ParameterError),
        ("sensor_frames", ["an eye"], ParameterError),
        ("object.vertices", [0.0, 0.0], ObjectError),
        ("arms", [], ParameterError),
        ("arms", ["left", "left"], ParameterError),
        ("arms", ["tail"], ParameterError),
        ("left.grasps", [0.0] * 7, GraspError),
        ("object.up", [0.0, 0.0, 0.0], ParameterError),
        ("object.up", [0.0, 0.0, 1e160], ParameterError),
        ("keep_out", [0.0, 0.0, 0.0, 1.0, 0.0, 1.0], ParameterError),
        ("keep_out", [0.0, 0.0, 0.0, 1.0, 1.0, 1.0] * 65, ParameterError),
        ("near_pose", [1e9, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], ParameterError),
        ("objective_weights", [1e300], ParameterError),
        ("require_terms", ["maximize_clearance"], ParameterError),
    ],
)
def test_bad_values_are_refused_by_name(name, value, error):
    with pytest.raises(error) as raised:
        ParameterSet(SPECS, {name: value})
    assert name in in_node_words(str(raised.value))


@pytest.mark.parametrize(
    ("values", "blamed"),
    [
        ({"objective_terms": ["high"], "objective_weights": [1.0, 2.0]}, "objective_weights"),
        ({"require_terms": ["high"]}, "require_at_least"),
        ({"require_terms": ["near"], "require_at_least": [-0.1]}, "require_terms"),
        ({"objective_terms": ["turn"]}, "objective_terms"),
        ({"objective_terms": ["high", "high"]}, "objective_terms"),
    ],
)
def test_what_does_not_fit_together_is_refused_at_start_and_not_before(values, blamed):
    wishes = ParameterSet(SPECS, values).planner_settings.wishes
    with pytest.raises(ParameterError) as refused:
        wishes.require_consistent()
    assert in_node_words(str(refused.value)).startswith(f"{blamed} =")


def test_numbers_may_come_as_text_as_yaml_takes_some_for_it():
    assert parameter_set(time_limit="1e-05")["time_limit"] == 1e-05
    volume = parameter_set(target_volume="[0, 0, 0, 1, 1.5, 1e-1]")["target_volume"]
    assert volume == [0.0, 0.0, 0.0, 1.0, 1.5, 0.1]
    for text in ("[0, 0, 0, 1, 1.5]", "0, 0, 0, 1, 1, 1", "[]", "[a, 0]", "nan", ""):
        with pytest.raises(ParameterError):
            parameter_set(target_volume=text)


def test_unknown_names_are_refused():
    with pytest.raises(ParameterError, match="no such parameter; the nearest is time_limit"):
        parameter_set().changed({"time_limits": 3.0})
    faults = parameter_set().changed_or_faults({f"name_{i}": 0 for i in range(5000)})
    assert len(faults) == 5000
    (fault,) = parameter_set().changed_or_faults({"n" * 100_000: array("d", [1.0, 2.0])})
    assert str(fault).endswith("... = [1.0, 2.0]: there is no such parameter")
    assert len(str(fault)) < 1100


@pytest.mark.parametrize(
    ("name", "most"), [("object.vertices", 900_000), ("object.triangles", 300_000)]
)
def test_a_mesh_that_is_too_large_is_refused_when_it_is_set(name, most):
    value = array("d" if name.endswith("vertices") else "q", bytes(24 * (most + 1)))
    with pytest.raises(ObjectError, match=rf"`{name[7:]}` = '{most + 1} of them': .* {most}"):
        parameter_set().changed({name: value})


@pytest.fixture
def node(ros):
    made = []

    def make(*arguments):
        node = Node("settings", cli_args=["--ros-args", *arguments] if arguments else None)
        made.append(node)
        return node

    yield make
    for each in made:
        each.destroy_node()


def test_integers_are_accepted_on_the_command_line_and_later(node):
    made = node("-p", "time_limit:=7", "-p", "target_volume:=[0, 0, 0, 1, 1, 1]")
    server = ParameterServer(made)
    assert server.current["time_limit"] == 7.0
    assert made.get_parameter("time_limit").type_ is Parameter.Type.DOUBLE
    result = made.set_parameters([Parameter("collision_margin", value=0)])[0]
    assert result.successful, result.reason
    assert server.current["collision_margin"] == 0.0
    assert made.get_parameter("collision_margin").type_ is Parameter.Type.DOUBLE


def test_arms_and_sensor_frames_bring_their_own_parameters(node):
    made = node("-p", "arms:=[third]", "-p", "sensor_frames:=[eye]", "-p", "third.tip_frame:=tool")
    server = ParameterServer(made)
    assert server.current["third.tip_frame"] == "tool"
    assert not made.has_parameter("left.tip_frame")
    assert server.current.sensor_pose("eye") is None
    set_to = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    assert made.set_parameters([Parameter("sensor_poses.eye", value=set_to)])[0].successful
    np.testing.assert_array_equal(server.current.sensor_pose("eye").translation, [0, 0, 1])


def test_the_page_of_parameters_is_current():
    docs = Path(__file__).parents[3] / "docs"
    page = runpy.run_path(str(docs / "parameters_page.py"))["parameter_page"]()
    kept = (docs / "parameters.md").read_text(encoding="utf-8")
    assert kept == page, "run python docs/parameters_page.py docs/parameters.md"


@pytest.mark.parametrize("name", ["arms", "sensor_frames"])
def test_what_is_named_twice_at_start_up_is_refused_in_words(ros, name):
    with pytest.raises(ParameterError, match="name each once"):
        ParameterServer(
            Node("twice", parameter_overrides=[Parameter(name, value=["left", "left"])])
        )
