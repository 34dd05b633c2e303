"""The independent checker: is a published solution right, judged by the scene's true solids?

It shares no code with the planner's own checks. Robot, scene and object are rebuilt from the URDF
text and from meshes; the motion is the quintic a joint_trajectory_controller plays.

The margin is owed to what was measured, given as boxes: it is checked to the 0.02 mm. True solids
stand out beyond that by up to 3 mm, as much as the margin: the bundled scenes' complete clouds, of
a point every 5 mm, leave 2.3 mm of them outside of the boxes in 99 % of all places, 2.7 mm to
3.3 mm in 99.9 %, and more only in the corner between two walls. So they are checked for
penetration.
"""

from .asked import check_asked
from .carrying import check_carrying, way_of_object
from .check import SolutionChecker
from .curve import check_limits, states_along
from .insides import piece_voxels
from .leaning import balance, check_leaning
from .pieces import object_pieces
from .robot import RobotModel
from .shapes import convex
from .stance import check_stance
from .surface import surface_normal
from .task import Asked, Solution, Task, Tolerances
from .world import World

__all__ = [
    "Asked",
    "RobotModel",
    "Solution",
    "SolutionChecker",
    "Task",
    "Tolerances",
    "World",
    "balance",
    "check_asked",
    "check_carrying",
    "check_leaning",
    "check_limits",
    "check_stance",
    "convex",
    "object_pieces",
    "piece_voxels",
    "states_along",
    "surface_normal",
    "way_of_object",
]
