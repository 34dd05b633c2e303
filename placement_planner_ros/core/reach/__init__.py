"""Reach of an arm: forward and inverse kinematics of one chain of joints.

`kinematics` is the chain itself. `ik` is what is asked: solutions for a pose, more of them along
self-motions, straight lines of the tip; `ik_kernels` and `self_motion` are its compiled loops,
`seeds` where they start. `reach_bound` says at once that a pose is too far away.
"""
