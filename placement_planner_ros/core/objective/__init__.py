"""ξ, what a placement is judged by.

`objective` is what the planner asks of one: a value per pose, and what else it may know.
`clearance` is the built-in one, `by_name` finds it and those that other packages install, `ascent`
follows the gradient of any.
"""
