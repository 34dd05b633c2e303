"""Limits on how the object is carried: by how much it may lean on its way.

`settings` says by how much, and `tilt` keeps it, on whole edges; it projects configurations to
where it is kept. `tilt_kernels` are the bounds it rests on. What it may be accelerated by is for
timing to keep (`timing/carried_point`).
"""
