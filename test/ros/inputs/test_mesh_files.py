"""Mesh files of every format, cut short, changed and made up: read, or refused in words."""

import functools
import json
import signal
import struct

import pytest
import trimesh

from placement_planner_ros.core.stopping import StoppedError, stoppable
from placement_planner_ros.ros.inputs import mesh_process
from placement_planner_ros.ros.inputs.mesh_process import MeshProcess

BOX = trimesh.creation.box((0.1, 0.06, 0.04))


def glb(count):
    """A file whose header is in order and whose accessor claims so many numbers of no buffer."""
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"componentType": 5126, "count": count, "type": "VEC3"}],
    }
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A)
    return head + text


@functools.cache
def bad():
    """Files that are none, by name."""
    return {
        "empty.stl": b"",
        "count.stl": b"\0" * 80 + struct.pack("<I", 2**32 - 1) + b"\0" * 100,
        "claim.ply": b"ply\nformat ascii 1.0\nelement vertex 100000000000\nproperty float x\n"
        b"element face 5\nproperty list uchar int vertex_indices\nend_header\n0\n",
        "list.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
        b"property float y\nproperty float z\nelement face 2\n"
        b"property list uint int vertex_indices\nend_header\n" + b"\xff" * 60,
        "claim.off": b"OFF\n200000 200000 0\n0 0 0\n",
        "claim.glb": glb(10**11),
        "nan.stl": BOX.export(file_type="stl")[:84] + b"\xff" * 600,
        "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99\n",
        "deep.dae": b"<COLLADA>" + b"<node>" * 100_000 + b"</node>" * 100_000 + b"</COLLADA>",
        "entity.dae": b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><COLLADA>&x;</COLLADA>',
        "a.zip": b"PK\3\4",
        "a.xyz": b"0 0 0\n",
        "noname": BOX.export(file_type="stl"),
        "wrong.ply": BOX.export(file_type="stl"),
        "wrong.stl": BOX.export(file_type="obj").encode(),
    }


@pytest.fixture(scope="module")
def process():
    with MeshProcess() as made:
        yield made


@pytest.mark.parametrize("name", bad())
def test_what_is_no_mesh_is_refused_in_words(tmp_path, process, name):
    path = tmp_path / name
    path.write_bytes(bad()[name])
    with pytest.raises((ValueError, OSError)) as error:
        process.read(path)
    assert len(str(error.value)) > 10


def test_reading_can_be_stopped_and_ends_in_time(tmp_path, monkeypatch):
    box = tmp_path / "box.stl"
    box.write_bytes(BOX.export(file_type="stl"))
    asked = [False]

    def hang() -> None:
        assert len(process.read(box)[1]) == 12
        process._child.send_signal(signal.SIGSTOP)  # as a loader that never ends

    with stoppable(lambda: asked[0]), MeshProcess() as process:
        hang()
        asked[0] = True
        with pytest.raises(StoppedError):
            process.read(box)
        asked[0] = False
        hang()
        monkeypatch.setattr(mesh_process, "PREPARING_S", 0.125)
        with pytest.raises(TimeoutError, match=r"0\.5 s"):
            process.read(box)
        monkeypatch.setattr(mesh_process, "PREPARING_S", 60.0)
        assert len(process.read(box)[1]) == 12
        process._child.kill()  # as whatever reads it may do to itself
        process._child.wait()
        with pytest.raises(ValueError, match="ended the process"):
            process.read(box)
        assert len(process.read(box)[1]) == 12
