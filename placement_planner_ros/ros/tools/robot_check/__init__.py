"""`placement_check_robot`: what the node would make of a robot, and what is wrong with it.

`given` reads the parameters, `findings` collects what is said, `subject` what is looked at; the
other files each look at one side of it.
"""
