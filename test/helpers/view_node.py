"""Statuses and solutions as the client hands them out."""

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point as PointMessage
from geometry_msgs.msg import Pose, PoseStamped
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from placement_planner_ros.client import Solution, Status
from placement_planner_ros.client.status import Validity


def status(run=7, solutions=0, state="searching", **values):
    """What the node says of a run."""
    values = {"run": run, "solutions": solutions, "state": state, "best_valid": "true", **values}
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return Status.of(DiagnosticStatus(message="words", values=pairs))


def solution(number=1, objective=0.2, time=1.0, run=7, arm="left", at=(0.4, 0.0, 0.1), **parts):
    """A solution of that number."""
    pose = Pose(position=PointMessage(x=at[0], y=at[1], z=at[2]))
    values = {
        "grasp": 0,
        "face": 0,
        "approach_start": 0.5,
        "terms": {},
        "pose": PoseStamped(header=Header(frame_id="yumi_body"), pose=pose),
        "trajectory": JointTrajectory(),
        "retreat_trajectory": None,
        "validity": Validity(),
        "words": "",
        **parts,
    }
    return Solution(
        run=run, number=number, objective=objective, search_time=time, arm=arm, **values
    )
