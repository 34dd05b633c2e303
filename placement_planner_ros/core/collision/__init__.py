"""An arm, its hand and the object against the obstacle set and the robot itself, certified.

Compiled kernels say that a distance is kept where that is certain, from coarse to fine: a field of
distance bounds, spheres, remembered planes and directions, the distance of two convex sets, and at
last that of the triangles of meshes. What lies so close to the margin that they cannot tell is not
free: no configuration, edge or pose passes that is not certain to be free.

What is asked: `arm` (configurations, edges, what a pose of the hand decides), `object` (the object
on its way straight down: c_f(x)), with `attached_object` for what the arm holds or has
left behind.
Kernels: `configurations`, `edges` and `swept_object` answer these questions with `against_boxes`
(a body and the obstacle set) and `against_robot` (two bodies), both of which end in `separation`
(two convex sets) or `placed_meshes`.
What they read: `shapes` and `spheres` from the robot's meshes, flat as `solids`, laid out by
`arrays` and put in the world by `placing`; the obstacle set from `boxes`.
"""
