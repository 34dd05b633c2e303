"""The node's services and results as an executive in Python wants them.

    with PlacementClient() as planner:
        solution = planner.place({"target_volume": [0.3, -0.5, 0.1, 0.7, 0.4, 0.4]}, deadline=5.0)
        ...  # carry out solution.trajectory, open the hand, carry out solution.retreat_trajectory
        planner.confirm_placed(solution)

`PlacementClient` works with a node of the caller's that somebody spins, and without one spins a
node of its own. Whatever does not end with a solution raises `PlacementError` with a code and
words. Loads nothing of the planner.
"""

from placement_planner_ros.client.answer import Answer
from placement_planner_ros.client.errors import PlacementError
from placement_planner_ros.client.placement_client import PlacementClient
from placement_planner_ros.client.solution import Solution
from placement_planner_ros.client.status import Status, Validity

__all__ = ["Answer", "PlacementClient", "PlacementError", "Solution", "Status", "Validity"]
