"""Bodies of large meshes are made once for all processes."""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core import kept_files
from placement_planner_ros.core.body import body_store
from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.body_store import body_key, keep_body, kept_body
from placement_planner_ros.core.body.convex_cover import Cover
from placement_planner_ros.core.body.settings import BodySettings

KEY = body_key(b"mesh", [0.0, 0.0, 0.01], 1.0, BodySettings())


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    monkeypatch.setattr(kept_files, "kept_folder", lambda: tmp_path)
    monkeypatch.setattr(body_store, "_MANY", 100)
    return tmp_path / "large-objects"


def ring():
    return trimesh.creation.annulus(0.02, 0.04, 0.03, sections=16)


def body(name):
    mesh = ring()
    if name == "ring and boxes":
        boxes = [trimesh.creation.box((0.03, 0.02, 0.01)) for _ in range(2)]
        for at, box in enumerate(boxes, 1):
            box.apply_translation((0.0, 0.0, 0.04 * at))
        mesh = trimesh.util.concatenate([boxes[0], mesh, boxes[1]])
    elif name == "open ring":
        mesh = trimesh.Trimesh(mesh.vertices, mesh.faces[1:], process=False)
    elif name == "ball":
        mesh = trimesh.creation.icosphere(2, 0.03)
    settings = BodySettings(allow_rolling=name == "ball")
    return Body.from_mesh(mesh.vertices, mesh.faces, cover=halves, settings=settings)


def halves(vertices, triangles, tolerance):
    """Stands for a cover, which takes longer to make."""
    left = vertices[:, 0] < 0.0
    return Cover((vertices[left], vertices[~left]), 0.02, closed=True)


def content(value):
    """All of a value, down to its numbers and words."""
    if hasattr(value, "homogeneous"):
        return value.homogeneous.tolist()
    if isinstance(value, np.ndarray):
        return str(value.dtype), value.shape, value.tobytes(), value.flags.writeable
    if isinstance(value, tuple):
        return tuple(map(content, value))
    if hasattr(value, "__dataclass_fields__"):
        return {name: content(getattr(value, name)) for name in value.__dataclass_fields__}
    return type(value), value


@pytest.mark.parametrize("name", ["ring", "ring and boxes", "open ring", "ball"])
def test_a_kept_body_is_the_same_to_the_last_bit(name):
    made = body(name)
    assert kept_body(KEY) is None
    keep_body(KEY, made)
    assert content(kept_body(KEY)) == content(made)


def test_other_meshes_places_scales_and_settings_have_other_bodies():
    center, scale, settings = [0.0, 0.0, 0.01], 1.0, BodySettings()
    others = {
        KEY,
        body_key(b"other", center, scale, settings),
        body_key(b"mesh", None, scale, settings),
        body_key(b"mesh", center, 1.0 + 1e-12, settings),
        body_key(b"mesh", center, scale, BodySettings(flatness=0.002)),
    }
    assert len(others) == 5


def test_small_ones_are_not_kept_and_damaged_ones_not_read(folder):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    keep_body(KEY, Body.from_mesh(box.vertices, box.faces))
    assert not folder.exists()
    keep_body(KEY, body("ring"))
    (file,) = folder.iterdir()
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(bytes(data))
    assert kept_body(KEY) is None
    assert not list(folder.iterdir())


def test_what_was_not_read_for_longest_goes_where_there_is_too_much(folder, monkeypatch):
    keys = [bytes([number]) for number in range(4)]
    made = body("ring")
    there: set[Path] = set()
    for age, key in enumerate(keys[:3]):
        keep_body(key, made)
        (new,) = set(folder.iterdir()) - there
        there.add(new)
        os.utime(new, (100 + age, 100 + age))
    assert kept_body(keys[0]) is not None  # now the newest
    size = max(path.stat().st_size for path in folder.iterdir())
    monkeypatch.setattr(kept_files, "MAX_KEPT", 3 * size)
    kept_files._ROOM.clear()
    keep_body(keys[3], made)
    assert [kept_body(key) is not None for key in keys] == [True, False, True, True]
