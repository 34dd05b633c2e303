"""What the planner calls its inputs, the node calls by its parameters and topics."""

import pytest

from placement_planner_ros.core.explanation.explanation import Remedy
from placement_planner_ros.ros.inputs.resources import Files
from placement_planner_ros.ros.inputs.robot_input import DescriptionError, RobotInput
from placement_planner_ros.ros.node_words import NODE_WORDS, in_node_words
from placement_planner_ros.ros.parameters.table import arm_specs, arms_spec, fixed_specs
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.share import share_path

SPECS = {s.name: s for s in (*fixed_specs(), arms_spec(["left"]), *arm_specs("left", yumi=True))}


def test_all_words_of_the_table_are_the_nodes():
    others = {"joint_states", "sensor_poses.<frame>"}
    assert set(", ".join(NODE_WORDS.values()).split(", ")) <= SPECS.keys() | others


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            str(Remedy("grasps of arm left, volume", "as in `q_start`")),
            "left.grasps, target_volume: as in joint_states",
        ),
        ("`grasps[3]` of arm left = 1: move it", "left.grasps[3] = 1: move it"),
        (str(Remedy("sensor pose", "correct it")), "sensor_poses.<frame>: correct it"),
        (str(Remedy("edge_margin", "lower it")), "edge_margin: lower it"),
        ("what `ros2 run xacro` makes of it", "what `ros2 run xacro` makes of it"),
    ],
)
def test_names_are_the_nodes_and_all_else_stays(words, said):
    assert in_node_words(words) == said


@pytest.mark.parametrize(
    ("share", "told"), [(0.0, "give the text of the file"), (0.5, "give the whole text")]
)
def test_a_description_that_is_cut_is_named_with_its_file(tmp_path, share, told):
    text = share_path("urdf", "yumi.urdf").read_text()
    file = tmp_path / "cut.urdf"
    file.write_text(text[: int(share * len(text))])
    given = RobotInput(ParameterSet(SPECS, {"robot_description": str(file)}), Files())
    given.wait()
    with pytest.raises(DescriptionError) as refused:
        _ = given.robot
    said = in_node_words(str(refused.value))
    assert said.startswith("robot_description")
    assert f" of {file} = " in said
    assert told in said
