"""PlanMotion: from the start to any of the goals.

`transit` plans the way there for each arm and grasp; `withdrawal` finds ways out of a goal, with
which the tree that grows back from it begins.
"""
