"""From a certified path to the curve that a controller plays.

`trajectory_maker` does all of it, with `rounding` of corners, `quintic` pieces between them and
`timing` along the whole under the limits of the joints.
"""
