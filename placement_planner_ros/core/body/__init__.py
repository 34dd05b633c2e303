"""The object: from a mesh to what can be planned with.

`body` is all of it, made as `settings` say: from a checked `mesh`, the `convex_part`s that hold it,
F and its vertices (`placement_face`) and B_o (`volume_points`).
"""
