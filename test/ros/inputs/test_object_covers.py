"""Objects that are not convex: covered in the background, once, and no longer than wanted."""

import threading
import time

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core import disk_cache
from placement_planner_ros.ros.inputs.mesh_process import MeshProcess
from placement_planner_ros.ros.inputs.object_input import ObjectInput
from placement_planner_ros.ros.inputs.resources import Files
from placement_planner_ros.ros.parameters.table import arm_specs, arms_spec, fixed_specs
from placement_planner_ros.ros.parameters.values import ParameterSet

WAIT = 60.0
FILES = Files.below([], [])
SPECS = {s.name: s for s in [*fixed_specs(), arms_spec(["left"]), *arm_specs("left", yumi=True)]}


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setattr(disk_cache, "cache_folder", lambda: tmp_path)


@pytest.fixture
def covers(monkeypatch):
    """What is covered, each time by which thread, as soon as the gate is open."""
    gate, made, original = threading.Event(), [], MeshProcess.cover

    def cover(self, vertices, triangles, tolerance, seconds):
        made.append(threading.current_thread().name)
        while not gate.wait(0.02):
            if self._should_stop():
                raise StoppedHereError
        return original(self, vertices, triangles, tolerance, seconds)

    monkeypatch.setattr(MeshProcess, "cover", cover)
    yield gate, made
    gate.set()


class StoppedHereError(Exception):
    """The work was ended."""


def ring(height=0.03):
    mesh = trimesh.creation.annulus(r_min=0.03, r_max=0.05, height=height, sections=12)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int64)


def settle(objects):
    end = time.monotonic() + WAIT
    while objects.state == "reading" and time.monotonic() < end:
        time.sleep(0.02)
    return objects.state


def test_a_cover_is_made_once_and_kept(covers, monkeypatch):
    gate, made = covers
    gate.set()
    parts = []
    for _ in range(2):
        objects = ObjectInput(ParameterSet(SPECS, {}), FILES)
        objects.set_mesh(*ring())
        assert settle(objects) == "ready"
        parts.append(objects.body(ParameterSet(SPECS, {})).mesh.cover.parts)
    assert len(made) == 1
    for first, second in zip(*parts, strict=True):
        np.testing.assert_array_equal(first, second)


def test_nobody_waits_for_the_cover_of_what_was_replaced(covers):
    gate, made = covers
    objects = ObjectInput(ParameterSet(SPECS, {}), FILES)
    objects.set_mesh(*ring())
    end = time.monotonic() + WAIT
    while not made and time.monotonic() < end:
        time.sleep(0.01)
    box = trimesh.creation.box((0.1, 0.06, 0.04))
    objects.set_mesh(np.asarray(box.vertices), np.asarray(box.faces, np.int64))
    assert settle(objects) == "ready"
    assert objects.body(ParameterSet(SPECS, {})).mesh is None
    assert len(made) == 1
    assert not gate.is_set()


@pytest.mark.parametrize("error", [ValueError("too large"), TimeoutError()])
def test_where_no_cover_can_be_made_its_hull_does_and_that_is_said(monkeypatch, error):
    def fail(*_):
        raise error

    monkeypatch.setattr(MeshProcess, "cover", fail)
    objects = ObjectInput(ParameterSet(SPECS, {}), FILES)
    objects.set_mesh(*ring())
    assert settle(objects) == "ready"
    body = objects.body(ParameterSet(SPECS, {}))
    assert len(body.mesh.cover.parts) == 1
    assert any("convex cover reaches" in warning for warning in body.warnings)
    assert len(body.mesh.triangles) == len(ring()[1])  # which decide as before
