"""A right solution, made by hand: the left arm puts the small box of crayons onto the table."""

import numpy as np
from checker import Solution, SolutionChecker, Tolerances
from helpers.tasks import yumi_task

from placement_planner_ros.core.types import Trajectory
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.scenes import scene_by_name

JOINTS = tuple(f"yumi_joint_{n}_l" for n in (1, 2, 7, 3, 4, 5, 6))
Q_START = {
    **dict(zip(JOINTS, (-0.93, -1.55, 0.0, 0.0, 0.0, 0.0, 0.0), strict=True)),
    **{
        f"yumi_joint_{n}_r": value
        for n, value in zip((1, 2, 7, 3, 4, 5, 6), (0.69, -1.95, 0, 0, 0, 0, 0), strict=True)
    },
    "gripper_l_joint": 0.0105,
    "gripper_r_joint": 0.0105,
}
WAYPOINTS = np.array(
    [  # q_0, 6 cm above the table, then straight down onto it
        [-0.93, -1.55, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-0.099495, 0.258764, 0.633102, 0.952818, -0.451185, -0.649064, -0.365126],
        [-0.073817, 0.299082, 0.625083, 0.917691, -0.418125, -0.640275, -0.403074],
        [-0.047856, 0.338104, 0.615706, 0.881582, -0.388449, -0.631946, -0.437511],
        [-0.021953, 0.375918, 0.605449, 0.844518, -0.361951, -0.623805, -0.468549],
        [0.003641, 0.412636, 0.59469, 0.806518, -0.338377, -0.615613, -0.496398],
        [0.028753, 0.448382, 0.583714, 0.767591, -0.317453, -0.607171, -0.521316],
        [0.053277, 0.483283, 0.57272, 0.727744, -0.298901, -0.598326, -0.543588],
    ]
)
TIMES = np.array([0.0, 4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 7.0])
STILL = np.zeros_like(WAYPOINTS)
OBJECTIVE = 0.06466
TOLERANCES = Tolerances(acceleration_limit=10.0)


TASK = yumi_task(
    scene_by_name("table"),
    object_by_name("small_crayons_box"),
    "maximize_clearance",
    q_start=Q_START,
)
CHECKER = SolutionChecker(TASK, TOLERANCES)


def make_solution() -> Solution:
    robot = CHECKER.robot
    q = robot.configuration({**Q_START, **dict(zip(JOINTS, WAYPOINTS[-1], strict=True))})
    T_tip_object = object_by_name("small_crayons_box").grasps["left"][0].homogeneous
    return Solution(
        trajectory=Trajectory(JOINTS, TIMES, WAYPOINTS, STILL, STILL),
        approach_start=4.0,
        placement_pose=robot.frame_pose(q, "gripper_l_base") @ T_tip_object,
        objective=OBJECTIVE,
        tip_frame="gripper_l_base",
        T_tip_object=T_tip_object,
        touch_links=("gripper_l_base", "gripper_l_finger_l", "gripper_l_finger_r"),
    )


GOOD = make_solution()
