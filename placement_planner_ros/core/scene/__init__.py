"""The surroundings of the robot: from clouds to the one obstacle set, and what follows from it.

`environment` is all of it for one problem. `grid` is the obstacle set, made by `cells` (points into
cells, and tight boxes around them) and `denoising` (lone points, noisy surfaces);
`flying_pixels` is what cameras put into the air, `freespace` the space that no sensor has seen.
`planes` are the slopes of what was measured, `layers` its surfaces as rasters of one height, made
with what `rasters` tells (distances, what is a gap); `support` answers s(x) in them, `regions` are
the placement regions R. `clearance` is d_S of the clearance objective, `distance` the
field that collision checks ask first.
"""
