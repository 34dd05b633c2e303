"""What the object must not suffer on its way: to be tilted, to be accelerated.

`settings` says how much of either, `tilt` keeps a direction of the held object near the vertical on
whole edges and projects configurations to where it is (`tilt_kernels`), `acceleration` bounds what
a point of the object does on a timed curve.
"""
