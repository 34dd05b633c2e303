from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.ros.outputs.answers import refusal


def test_a_fault_that_is_met_twice_is_told_once():
    faults = [RobotError("robot_description", "x", "is not XML") for _ in range(2)]
    assert refusal(faults).text.splitlines() == [
        "code=BAD_PARAMETER",
        "BAD_PARAMETER: robot_description = 'x': is not XML",
    ]
