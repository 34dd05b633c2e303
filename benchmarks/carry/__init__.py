"""The 24 cases with an object that must stay upright on its way, beside runs in which it need not.

`starts` makes the tasks, `runs` runs them and counts.
"""
