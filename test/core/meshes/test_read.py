"""Every kind of mesh file, as programs write them, is the same solid."""

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core.meshes.read import read_mesh

BOX = trimesh.creation.box((0.1, 0.06, 0.04))
TEXT, BINARY = BOX.export(file_type="stl_ascii"), BOX.export(file_type="stl")


def scene():
    """A box, one that a transform moves, and one that it mirrors."""
    made = trimesh.Scene()
    made.add_geometry(BOX)
    made.add_geometry(BOX, transform=trimesh.transformations.translation_matrix([1, 0, 0]))
    mirrored = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirrored[1, 3] = 1.0
    made.add_geometry(BOX, transform=mirrored)
    return made


def quads():
    """An .obj with two objects, materials that are not there, texture coordinates and normals."""
    lines = ["# caf\u00e9", "mtllib missing.mtl", "vt 0 0", "vt 1 1", "vn 0 0 1"]
    lines += [f"v {x} {y} {z} 0.5 0.5 0.5" for x, y, z in BOX.vertices]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    for number, face in enumerate(faces):
        if number in (0, 3):
            lines += [f"o part{number}", f"usemtl {number}"]
        lines.append("f " + " ".join(f"{i + 1}/{1 + number % 2}/1" for i in face))
    return "\n".join(lines).encode("latin-1")


FILES = {
    "binary.stl": BINARY,
    "UPPER.STL": BINARY,
    "solid.stl": b"solid" + BINARY[5:],
    "appended.stl": BINARY + b"what some programs add",
    "text.stl": TEXT.encode(),
    "windows.stl": TEXT.replace("\n", "\r\n").upper().encode(),
    "latin.stl": TEXT.replace("solid", "solid caf\u00e9", 1).encode("latin-1"),
    "a.obj": BOX.export(file_type="obj").encode(),
    "quads.obj": quads(),
    "text.ply": BOX.export(file_type="ply", encoding="ascii"),
    "binary.ply": BOX.export(file_type="ply"),
    "a.off": BOX.export(file_type="off").encode(),
    "a.glb": BOX.export(file_type="glb"),
}


@pytest.mark.parametrize("name", FILES)
def test_each_kind_is_the_same_closed_box(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name])
    vertices, triangles = read_mesh(tmp_path / name)
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    assert vertices.shape == (8, 3)
    assert triangles.shape == (12, 3)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(BOX.volume)


def test_transforms_of_a_scene_count(tmp_path):
    (tmp_path / "a.glb").write_bytes(scene().export(file_type="glb"))
    mesh = trimesh.Trimesh(*read_mesh(tmp_path / "a.glb"), process=False)
    np.testing.assert_allclose(mesh.bounds, [[-0.05, -0.03, -0.02], [1.05, 1.03, 0.02]], atol=1e-7)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(3.0 * BOX.volume)


def test_what_it_cannot_read_it_says(tmp_path):
    path = tmp_path / "a.gltf"
    path.write_text("{}")
    with pytest.raises(ValueError, match=r"\.gltf is not read; use \.stl.*\.dae"):
        read_mesh(path)


ASSET = b'{"version":"2.0","generator":"https://github.com/mikedh/trimesh"}'
STRIPS = b"element tristrips 1\nproperty list int int vertex_indices\nend_header"


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("a.glb", b'"mode":4', b'"mode":6'),
        ("a.glb", ASSET, b'{"version":"2.0"},"skins":[{}]'),
        ("a.glb", ASSET, b'{"version":"2.0"},"extensionsRequired":["E"]'),
        ("text.ply", b"end_header", STRIPS),
        ("text.ply", b"element face 12", b"element face 13"),
    ],
)
def test_what_a_loader_would_leave_out_is_refused(tmp_path, name, old, new):
    assert FILES[name].count(old) == 1
    (tmp_path / name).write_bytes(FILES[name].replace(old, new.ljust(len(old))))
    with pytest.raises(ValueError, match="export"):
        read_mesh(tmp_path / name)


@pytest.mark.parametrize("odd", ["nan", "inf"])
@pytest.mark.parametrize("kind", ["stl_ascii", "stl", "obj", "off", "ply", "glb"])
def test_vertices_that_are_no_numbers_are_refused_with_their_count(tmp_path, kind, odd):
    vertices = np.array(BOX.vertices)
    vertices[[2, 5], [1, 0]] = float(odd)
    mesh = trimesh.Trimesh(vertices, BOX.faces, process=False, validate=False)
    data = mesh.export(file_type=kind)
    name = f"a.{kind.removesuffix('_ascii')}"
    (tmp_path / name).write_bytes(data if isinstance(data, bytes) else data.encode())
    corners = 2 if kind in ("obj", "off", "ply", "glb") else int(np.isin(BOX.faces, [2, 5]).sum())
    with pytest.raises(ValueError, match=f"^{corners} of its vertices are not finite"):
        read_mesh(tmp_path / name)
