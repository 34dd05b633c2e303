"""What stands around the robot: from clouds to the one obstacle set, and what follows from it.

`environment` is all of it for one problem. `grid` is the obstacle set, made by `binning` (points
into cells), `denoising` (flying pixels, noisy surfaces) and `tight_boxes` (boxes around what is
left); `visibility` adds the space that no sensor has seen.
`planes` are the slopes of what was measured, `layers` its surfaces as rasters of one height, made
by `transforms` (distances) and `granulometry` (what is a gap); `support` answers s(x) in them,
`regions` are the placement regions R. `clearance` is d_S of the clearance objective, `distance` the
field that collision checks ask first.
"""
