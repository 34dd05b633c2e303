"""Anytime placement planning for robot manipulators on ROS 2.

Where the symbols of Haustein et al., "Object Placement Planning and Optimization for Robot
Manipulators", live:

===============================================  ==================================================
paper                                            module under `placement_planner_ros.core`
===============================================  ==================================================
V, target volume                                 types.TargetVolume
S, surface points; occupancy grid                scene.grid.ObstacleSet
R, r, placement contact regions                  scene.regions.Region, find_regions
d_S, distance to the environment                 scene.distance.ClearanceField
B_o, F, f, v(f), fT_o                            body.Body, body.PlacementFace
Ŝ(r, f)                                          feasibility.placement_pose
s(x), c_f(x)                                     feasibility.PoseConstraints
ξ(x), C(x)                                       objective
A, a; gT_o; O(q)                                 robot.arm.Arm; holding.Holding.object_pose
J†, inverse kinematics                           robot.kinematics.Chain, robot.ik
C_free                                           robot.collision.ArmCollision
AFR hierarchy, Ch(n)                             search.hierarchy
G_s, v(n), r(n), UCB1; SelectAfrNode (Alg. 3)    search.tree.SearchTree
SampleGoals (Alg. 2), g_max; H                   search.sampler, search.mcts; goals.GoalFinder
PlanMotion, M_s, 𝒢, m_max                        transit.MotionPlanner, motion.birrt.GoalSetRRT
OptimizeLocally, μ                               refine.LocalOptimizer, ascent.climb
Alg. 1, ξ_best, τ                                planner.PlacementPlanner
===============================================  ==================================================

`ros` is the adapter around it; nothing else imports ROS.
"""
