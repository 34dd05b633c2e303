"""Mesh files of every format, cut short, changed and made up: read, or refused in words."""

import functools
import gzip
import io
import json
import signal
import struct
import zipfile

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.errors import ObjectError
from placement_planner_ros.core.meshes.read import check_header
from placement_planner_ros.ros.inputs import mesh_process
from placement_planner_ros.ros.inputs.mesh_process import MeshProcess, MeshProcessStoppedError

BOX = trimesh.creation.box((0.1, 0.06, 0.04))
POINTS = " ".join(map(str, BOX.vertices.ravel()))
DAE = f"""<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"
version="1.4.1"><asset/><library_geometries><geometry id="g"><mesh><source id="s">
<float_array id="f" count="24">{POINTS}</float_array><technique_common><accessor source="#f"
count="8" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source><vertices id="v">
<input semantic="POSITION" source="#s"/></vertices><triangles count="12"><input offset="0"
semantic="VERTEX" source="#v"/><p>{" ".join(map(str, BOX.faces.ravel()))}</p></triangles></mesh>
</geometry></library_geometries><library_visual_scenes><visual_scene id="w"><node>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


def archive(**members):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(name.replace("__", "."), data)
    return out.getvalue()


def whole():
    """A small file of each format."""
    return {
        "ascii.stl": BOX.export(file_type="stl_ascii").encode(),
        "binary.stl": BOX.export(file_type="stl"),
        "a.obj": BOX.export(file_type="obj").encode(),
        "ascii.ply": BOX.export(file_type="ply", encoding="ascii"),
        "binary.ply": BOX.export(file_type="ply"),
        "a.off": BOX.export(file_type="off").encode(),
        "a.glb": BOX.export(file_type="glb"),
        "a.dae": DAE.encode(),
    }


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
        "minus.ply": b"ply\nformat ascii 1.0\nelement vertex -4\nend_header\n0\n",
        "list.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
        b"property float y\nproperty float z\nelement face 2\n"
        b"property list uint int vertex_indices\nend_header\n" + b"\xff" * 60,
        "claim.off": b"OFF\n200000 200000 0\n0 0 0\n",
        "words.off": b"OFF\nmany more few\n",
        "claim.glb": glb(10**11),
        "nan.stl": BOX.export(file_type="stl")[:84] + b"\xff" * 600,
        "index.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99\n",
        "fan.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf" + b" 1 2 3" * 100_001 + b"\n",
        "deep.dae": b"<COLLADA>" + b"<node>" * 100_000 + b"</node>" * 100_000 + b"</COLLADA>",
        "entity.dae": b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><COLLADA>&x;</COLLADA>',
        "laughs.dae": b'<!DOCTYPE a [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]><COLLADA>&b;</COLLADA>',
        "a.zip": archive(a__stl=BOX.export(file_type="stl")),
        "a.zae": archive(a__dae=DAE),
        "a.stl.gz": gzip.compress(BOX.export(file_type="stl")),
        "a.gltf": b"{}",
        "a.xyz": b"0 0 0\n",
        "noname": BOX.export(file_type="stl"),
        "wrong.glb": BOX.export(file_type="stl"),
        "wrong.ply": BOX.export(file_type="stl"),
        "wrong.obj": BOX.export(file_type="stl"),
        "wrong.dae": BOX.export(file_type="stl"),
        "wrong.stl": BOX.export(file_type="obj").encode(),
        "wrong.off": BOX.export(file_type="obj").encode(),
        "a.tar.gz": gzip.compress(b"ustar" * 100),
    }


def changed():
    """Whole files cut at several places, and with bytes changed."""
    rng = np.random.default_rng(12)
    for name, data in whole().items():
        for part in (0.1, 0.3, 0.5, 0.7, 0.9, 0.99):
            yield f"cut{part}-{name}", data[: int(part * len(data))]
        for number in range(16):
            other = bytearray(data)
            for place in rng.integers(0, len(data), 1 + number):
                other[place] = rng.integers(0, 256)
            yield f"changed{number}-{name}", bytes(other)


@pytest.fixture(scope="module")
def process():
    with MeshProcess() as made:
        yield made


@pytest.mark.parametrize("name", list(whole()))
def test_every_format_is_read(tmp_path, process, name):
    path = tmp_path / name
    path.write_bytes(whole()[name])
    vertices, triangles, _ = process.read(path)
    assert vertices.shape == (8, 3)
    assert len(triangles) == 12
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.1, 0.06, 0.04], atol=1e-6)


@pytest.mark.parametrize("name", bad())
def test_what_is_no_mesh_is_refused_in_words(tmp_path, process, name):
    path = tmp_path / name
    path.write_bytes(bad()[name])
    with pytest.raises((ValueError, OSError)) as error:
        process.read(path)
    assert len(str(error.value)) > 10


def attempt(read):
    """What it returns, and in words why it does not."""
    try:
        return read(), ""
    except (ValueError, OSError, ObjectError) as error:
        return None, str(error)


def test_files_cut_or_changed_are_read_or_refused_in_words(tmp_path, process):
    read, refused = 0, []
    for name, data in changed():
        path = tmp_path / name
        path.write_bytes(data)
        mesh, words = attempt(lambda path=path: process.read(path))
        if mesh is not None:
            read += 1
            assert np.isfinite(mesh[0]).all()
            try:
                Body.from_mesh(*mesh[:2])
            except ObjectError:
                continue
        else:
            refused.append(words)
    assert min(map(len, refused)) > 10
    assert read + len(refused) == 22 * len(whole())
    assert read > 10
    assert len(refused) > 20


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nan.stl", r"36 of its vertices|vertices are NaN"),
        ("a.zip", r"\.zip is not read; use \.stl"),
        ("entity.dae", "an entity"),
    ],
)
def test_the_reason_is_told(tmp_path, process, name, words):
    path = tmp_path / name
    path.write_bytes(bad()[name])
    with pytest.raises(ValueError, match=words):
        process.read(path)


def test_a_large_file_is_refused_by_its_size(tmp_path):
    path = tmp_path / "large.obj"
    with path.open("wb") as file:
        file.truncate(64_000_001)
    with pytest.raises(ValueError, match=r"64000001 bytes.*64000000"):
        check_header(path)


def test_reading_can_be_stopped_and_ends_in_time(tmp_path, monkeypatch):
    box = tmp_path / "box.stl"
    box.write_bytes(BOX.export(file_type="stl"))
    asked = [False]

    def hang() -> None:
        assert len(process.read(box)[1]) == 12
        process._child.send_signal(signal.SIGSTOP)  # as a loader that never ends

    with MeshProcess(lambda: asked[0]) as process:
        hang()
        asked[0] = True
        with pytest.raises(MeshProcessStoppedError):
            process.read(box)
        asked[0] = False
        hang()
        monkeypatch.setattr(mesh_process, "MAX_TIME_S", 0.5)
        with pytest.raises(TimeoutError, match=r"0\.5 s"):
            process.read(box)
        monkeypatch.setattr(mesh_process, "MAX_TIME_S", 60.0)
        assert len(process.read(box)[1]) == 12
        process._child.kill()  # as whatever reads it may do to itself
        process._child.wait()
        with pytest.raises(ValueError, match="ended the process"):
            process.read(box)
        assert len(process.read(box)[1]) == 12
