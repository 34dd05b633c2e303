"""Puts down one box after the other: place, carry out, confirm, next.

Start the node in another terminal first:

    placement_planner --ros-args --params-file config/small_crayons_box.yaml

`put_down` is what an executive is about. Robot and camera are simulated; yours have controllers
and drivers instead of `SimulatedRobot`.
"""

from __future__ import annotations

import threading
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from placement_planner_ros.client import PlacementClient, PlacementError, Solution
from placement_planner_ros.ros.inputs.point_cloud import message_from_points
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import start_configuration

BOXES = 3
SECONDS = 6.0
"""Time to search for each place."""
SPEED = 5.0
"""How much faster than planned the simulated robot moves, so that nobody has to wait."""


def put_down(planner: PlacementClient, robot: SimulatedRobot) -> Solution:
    """Put down what the robot holds, at the best place found."""
    solution = planner.place({"objective": "maximize_clearance"}, deadline=SECONDS)
    still = planner.validity(solution)
    if not still:  # something came into the way; an executive would place again
        raise PlacementError("NO_SOLUTION", still.reason, solution.run)
    robot.follow(solution.trajectory)
    robot.open_hand()
    if solution.retreat_trajectory is not None:  # there is one unless require_retreat is false
        robot.follow(solution.retreat_trajectory)
    planner.confirm_placed(solution)  # from now on it is an obstacle, and may be stood upon
    return solution


class SimulatedRobot(Node):
    """Goes where trajectories lead, and says where it is and what its camera sees."""

    def __init__(self) -> None:
        super().__init__("simulated_robot")
        self.take_next()
        scene = complete_cloud(scene_by_name("cabinet_high_clutter"))
        self._cloud = message_from_points(scene, Header(frame_id="yumi_body"))
        self._points = self.create_publisher(PointCloud2, "points", 1)
        self._joint_states = self.create_publisher(JointState, "joint_states", 10)
        self.create_timer(0.5, lambda: self._points.publish(self._cloud))
        self.create_timer(0.02, self._publish_joints)

    def take_next(self) -> None:
        """Somebody puts the next box into the hand, where the robot always begins."""
        self._joints = {
            name: float(q) for name, q in start_configuration("small_crayons_box").items()
        }

    def follow(self, trajectory: JointTrajectory) -> None:
        """What a joint_trajectory_controller does."""
        begun = time.monotonic()
        for point in trajectory.points:
            due = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
            time.sleep(max(0.0, begun + due / SPEED - time.monotonic()))
            self._joints |= dict(zip(trajectory.joint_names, point.positions, strict=True))

    def open_hand(self) -> None:
        """What a gripper's driver does."""
        self._joints |= {"gripper_l_joint": 0.025, "gripper_r_joint": 0.025}

    def _publish_joints(self) -> None:
        stamp = self.get_clock().now().to_msg()
        names, positions = list(self._joints), list(self._joints.values())
        self._joint_states.publish(
            JointState(header=Header(stamp=stamp), name=names, position=positions)
        )


def main() -> None:
    """Put down some boxes."""
    rclpy.init()
    robot = SimulatedRobot()
    executor = SingleThreadedExecutor()
    executor.add_node(robot)
    spinning = threading.Thread(target=executor.spin)
    spinning.start()
    try:
        with PlacementClient() as planner:  # which spins a node of its own
            planner.wait_until_ready(300.0)
            for number in range(BOXES):
                placed = put_down(planner, robot)
                print(f"box {number + 1}: {placed.words}")
                robot.take_next()
    finally:
        executor.shutdown()
        spinning.join()
        robot.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    main()
