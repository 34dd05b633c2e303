"""A body from disk is the one that was made."""

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core import disk_cache
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.convex_cover import Cover
from placement_planner_ros.core.body.settings import BodySettings


def halves(vertices, triangles, tolerance):
    """Stands for a cover, which takes longer to make."""
    left = vertices[:, 0] < 0.0
    return Cover((vertices[left], vertices[~left]), 0.02, closed=True)


def content(value):
    """All of a value, down to its numbers and words, and to what kernels are compiled for."""
    if hasattr(value, "homogeneous"):
        return value.homogeneous.tolist()
    if isinstance(value, np.ndarray):
        flags = value.flags.writeable, value.flags.c_contiguous, value.flags.aligned
        return str(value.dtype), value.shape, value.tobytes(), flags
    if isinstance(value, tuple):
        return tuple(map(content, value))
    if hasattr(value, "__dataclass_fields__"):
        return {name: content(getattr(value, name)) for name in value.__dataclass_fields__}
    return type(value), value


@pytest.mark.parametrize("name", ["ring and boxes", "ball"])
def test_a_kept_body_is_the_same_to_the_last_bit(name, monkeypatch, tmp_path):
    monkeypatch.setattr(disk_cache, "cache_folder", lambda: tmp_path)
    if name == "ball":
        mesh = trimesh.creation.icosphere(2, 0.03)
    else:
        boxes = [trimesh.creation.box((0.03, 0.02, 0.01)) for _ in range(2)]
        for at, box in enumerate(boxes, 1):
            box.apply_translation((0.0, 0.0, 0.04 * at))
        ring = trimesh.creation.annulus(0.02, 0.04, 0.03, sections=16)
        mesh = trimesh.util.concatenate([boxes[0], ring, boxes[1]])
    settings = BodySettings(allow_rolling=name == "ball")
    made = Body.from_mesh(mesh.vertices, mesh.faces, cover=halves, settings=settings)
    disk_cache.keep_result("bodies", "key", made)
    assert content(disk_cache.find_result("bodies", "key")) == content(made)
