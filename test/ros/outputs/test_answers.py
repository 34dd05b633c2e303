from placement_planner_ros.core.errors import ParameterError, RobotError
from placement_planner_ros.ros.outputs.answers import refusal


def test_a_fault_that_is_met_twice_is_told_once():
    faults = [RobotError("robot_description", "x", "is not XML") for _ in range(2)]
    assert refusal(faults).text.splitlines() == [
        "code=BAD_PARAMETER",
        "BAD_PARAMETER: robot_description = 'x': is not XML",
    ]


def test_of_many_faults_the_first_are_told_and_the_others_counted():
    faults = [ParameterError(f"name_{i}", i, "is bad") for i in range(400)]
    lines = refusal(faults).text.splitlines()
    assert lines[0] == "code=BAD_PARAMETER"
    assert lines[1] == "BAD_PARAMETER: name_0 = 0: is bad"
    assert lines[-1].endswith(" and 388 more")
    assert len(lines) == 13


def test_an_answer_can_be_sent_whatever_files_are_called():
    fault = RobotError("robot_description", "x", "there is no file /home/caf\udce9/robot.urdf")
    assert b"/home/caf?/robot.urdf" in refusal([fault]).text.encode()
