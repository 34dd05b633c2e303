"""An arm, its hand and the object against the obstacle set and the robot itself, certified.

Compiled kernels answer FREE or COLLIDING where that is certain, from coarse to fine: a field of
distance bounds, spheres and balls, remembered planes and directions, and at last the distance
between two convex sets, bounded from both sides. What lies so close to the margin that they leave
it UNDECIDED is not free: no configuration, edge or pose passes that is not certain to be free.

What is asked: `arm` (configurations, edges, what a pose of the hand decides), `object` (the object
on its way straight down: c_f(x)), with `attached_object` for what the arm holds or has
left behind.
Kernels: `configurations`, `edges` and `swept_object` answer these questions with `against_boxes`
(a body and the obstacle set), `against_robot` (two bodies) and `pair_tables` (two bodies that two
joints move, made by `table_filling`), all of which end in `separation` (two convex sets).
What they read: `shapes` and `spheres` from the robot's meshes, flat as `solids`, laid out by
`arrays` and put in the world by `placing`; the obstacle set from `boxes`.
"""
