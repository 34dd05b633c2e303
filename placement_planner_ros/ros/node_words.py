"""The planner's words for what it is given, and the node's.

Core names settings and inputs in backticks, as who calls it from Python writes them; whatever node
and page say goes through `in_node_words`. Loads nothing that has to be compiled.
"""

from __future__ import annotations

import re

from placement_planner_ros.core.errors import sayable

SETTINGS = {
    "planner_settings": {
        "sampler": "sampler",
        "local_optimization": "local_optimization",
        "collision_margin": "collision.collision_margin",
        "contact_tolerance": "collision.contact_tolerance",
        "support": "support",
        "support_margin": "support_margin",
        "edge_margin": "edge_margin",
        "support_region": "support_region",
        "contacts": "contacts",
        "friction": "friction",
        "stability_margin": "stability_margin",
        "approach_distance": "approach.approach_distance",
        "retreat_distance": "retreat.retreat_distance",
        "require_retreat": "require_retreat",
        "keep_out": "keep_out",
        "objective_terms": "wishes.terms",
        "objective_weights": "wishes.weights",
        "near_pose": "wishes.near_pose",
        "require_terms": "wishes.required",
        "require_at_least": "wishes.at_least",
        "velocity_scaling": "timing.velocity_scaling",
        "acceleration_scaling": "timing.acceleration_scaling",
        "acceleration_limits": "timing.acceleration_limits",
        "carry.max_tilt": "carry.max_tilt",
        "carry.max_acceleration": "carry.max_acceleration",
        "object.up": "turns.up",
        "object.up_tolerance": "turns.up_tolerance",
        "object.front": "turns.front",
        "object.front_direction": "turns.front_direction",
        "object.front_tolerance": "turns.front_tolerance",
    },
    "grid_settings": {"cloud.cell_size": "cell_size"},
    "region_settings": {"max_slope": "max_slope"},
    "body_settings": {"object.flatness": "flatness", "object.allow_rolling": "allow_rolling"},
}
"""The parameters that are fields of settings, by the attribute of a `ParameterSet` that these
settings are, and where they stand there."""
NODE_WORDS = {
    "volume": "target_volume",
    "environment": "cloud_topics",
    "own points": "self_filter.enabled, self_filter.padding",
    "with_unknown": "unknown_space",
    "root frame": "planning_frame",
    "q_start": "joint_states",
    "urdf": "robot_description",
    "srdf": "robot_description_semantic",
    "joint_limits": "robot_description_planning",
    "body": "object.mesh",
    "vertices": "object.vertices",
    "triangles": "object.triangles",
    "center_of_mass": "object.center_of_mass",
    "scale": "object.scale",
    "sensor pose": "sensor_poses.<frame>",
    # of settings the fields, as the parameters that set them
    **{path.rpartition(".")[2]: name for of in SETTINGS.values() for name, path in of.items()},
}
"""What the planner's words are to the node."""
_NAMED = re.compile(r"`([a-z_.]+(?: [a-z]+)?)`")
_OF_ARM = re.compile(r"`(\w+(?:\[\d+\])?)` of arm ([^\s,;:]+)")


def in_node_words(words: str) -> str:
    """The planner's words as the node says them, ready to be sent and logged."""
    # what an arm has is set by a parameter that begins with the arm's name
    of_arms = _OF_ARM.sub(r"\2.\1", words)
    return sayable(_NAMED.sub(_node_word, of_arms))


def _node_word(found: re.Match[str]) -> str:
    # two words that are not in the table are no name, as in a command
    otherwise = found[0] if " " in found[1] else found[1]
    return NODE_WORDS.get(found[1], otherwise)
