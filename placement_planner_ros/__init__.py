"""Anytime placement planning for robot manipulators: a library, and a ROS 2 node around it.

The library in a few names, loaded when they are first asked for: `Robot`, `Body`, `TargetVolume`
and `Environment` are what is given, `plan` yields each `Placement` found. `PlannerSettings` says
how to search, with `TurnSettings`, `WishSettings` and `CarrySettings` of what is asked of a
placement; all errors for bad input are `PlacementPlannerError`s. `examples/library.py`
shows them together. `ros` is the adapter around them; nothing else imports ROS.

Where the symbols of Haustein et al., "Object Placement Planning and Optimization for Robot
Manipulators", live:

============================================  =====================================================
paper                                         module under `placement_planner_ros.core`
============================================  =====================================================
𝒜, a; q_0                                     robot.arm.Arm; problem.Problem
V, target volume                              types.TargetVolume
𝒮, surface points; occupancy grid             scene.grid.ObstacleSet
R, r, placement contact regions; z_r          scene.environment.find_regions, scene.regions.Region
o, F, f, v(f), fT_o, B_o                      body.body.Body, body.placement_face.PlacementFace
gT_o, grasps; O(q)                            robot.arm.Arm; grasp.holding.Holding.object_pose
Ŝ(r, f)                                       contacts.face.FaceContact.poses
s(x)                                          constraints.PoseConstraints.stable
c_f(x)                                        constraints.PoseConstraints.free
... both of many poses at once                constraints.PoseConstraints.verdicts
r(x), path-reachability                       plan_motion.transit.MotionPlanner
C_free                                        collision.arm.ArmCollision
ξ(x), clearance                               objective.clearance.Clearance
d_S, distance to the environment              scene.clearance.ClearanceField
Algorithm 1, Terminate, ξ_best                planner.PlacementPlanner.run
τ, published                                  types.Placement, timing.trajectory_maker
g_max                                         search.sampler.SamplerSettings
m_max                                         planner.PlannerSettings
SampleGoals (Algorithm 2), 𝒢_n                search.sampler.BatchSampler.sample_goals
... its constraints in order                  sample_goals.goals.GoalFinder
... Sample; IKSolver                          scene.regions.RegionPoints.sample; reach.ik
... by optimistic search, the default         search.optimistic.OptimisticSampler
AFR hierarchy, Ch(n), l                       search.hierarchy.AfrHierarchy
SelectAfrNode (Algorithm 3), UCB1             search.tree.SearchTree.select
... its c                                     search.mcts.MctsSettings
G_s, v(n), r(n), Update                       search.tree.SearchTree, search.tree.SearchTree.update
Δr(n); H                                      search.mcts.MctsSampler; search.mcts.checks_passed
PlanMotion; 𝒢, M_s                            plan_motion.transit.MotionPlanner.plan
... 𝒢_o, dropped where no better              plan_motion.transit.MotionPlanner.retire_up_to
... its bidirectional RRT                     motion.birrt.GoalSetRRT
OptimizeLocally                               optimize_locally.LocalOptimizer.optimize
... ∂ξ/∂(x, y, e_z)                           objective.objective.objective_gradient
... μ                                         objective.ascent.climb_objective
... J; J†                                     reach.kinematics.Chain.jacobian; optimize_locally
============================================  =====================================================
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from placement_planner_ros.core.body.body import Body
    from placement_planner_ros.core.carry.settings import CarrySettings
    from placement_planner_ros.core.errors import PlacementPlannerError
    from placement_planner_ros.core.planner import PlannerSettings
    from placement_planner_ros.core.robot.model import Robot
    from placement_planner_ros.core.scene.environment import Environment
    from placement_planner_ros.core.types import Placement, TargetVolume
    from placement_planner_ros.core.wishes.settings import TurnSettings, WishSettings
    from placement_planner_ros.library import plan

__all__ = [
    "Body",
    "CarrySettings",
    "Environment",
    "Placement",
    "PlacementPlannerError",
    "PlannerSettings",
    "Robot",
    "TargetVolume",
    "TurnSettings",
    "WishSettings",
    "plan",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.library"), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
