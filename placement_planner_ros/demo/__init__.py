"""`placement_demo`: the main job from end to end, with nothing prepared."""
