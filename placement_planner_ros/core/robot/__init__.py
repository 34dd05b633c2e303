"""URDF and SRDF to one immutable model; it knows nothing of the object or the surroundings.

`description` reads the text, `geometry` the meshes of the links, `allowed_pairs` which links may
touch. `model` is the robot, `arm` one of its arms with hand and grasps.
"""
