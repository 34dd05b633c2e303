"""Having the object in hand, letting it go, and drawing back.

`holding` is an arm with the object in one grasp: configurations for a pose, the way down to it
(`straight_down`).
`hand_opening` tells whether the fingers can open and what they sweep, `open_hand` is release and
retreat, `feasible_grasps` which arms and grasps can take part; `settings` of all.
"""
