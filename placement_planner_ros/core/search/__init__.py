"""The search over arms, grasps and cells of poses; it knows nothing of robots.

`sampler` is SampleGoals as all samplers share it: `optimistic` (the default), `mcts` (over the
`tree`) and `uniform`. They search the `hierarchy` of arms, grasps, faces, regions and angles;
`optimistic` its cells, rows of an array (`cell_layout`). What is known of whole cells, for proofs and
for where to draw, is told by the bounds of `pruning`.
"""
