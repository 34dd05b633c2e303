"""SampleGoals: from a cell of poses and grasps to goals.

`goals` puts a sample to every constraint in the order of its cost, `cell_bounds` says what holds
for all of a cell.
"""
