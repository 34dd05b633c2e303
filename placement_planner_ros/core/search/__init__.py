"""The search over arms, grasps and cells of poses; it knows nothing of robots.

`sampler` is SampleGoals as all samplers share it: `optimistic` (the default), `mcts` (over the
`tree`) and `uniform`. They search the `hierarchy` of arms, grasps, faces, regions and angles;
`optimistic` its cells, rows of an array (`cell_layout`). `pruning` is what is known of whole cells,
for proofs and for where to draw.
"""
