"""What stands around the robot: from clouds to the one obstacle set, and what follows from it.

`environment` is all of it for one problem. `grid` is the obstacle set, made by `binning` (points
into cells), `denoising` (flying pixels, noisy surfaces) and `tight_boxes` (boxes around what is
left); `visibility` adds the space that no sensor has seen.
`surfaces` are its level tops, `regions` the placement regions R, `region_points` points on them,
`support` answers s(x). `distance` is d_S of the clearance objective, `distance_bound` the field
that collision checks ask first.
"""
