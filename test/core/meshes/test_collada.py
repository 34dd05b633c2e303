"""COLLADA files as programs write them: every kind of primitive, transform and reference."""

import tempfile
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core.meshes.read import read_mesh

BOX = trimesh.creation.box((0.1, 0.06, 0.04))
PLACED = '<instance_geometry url="#g"/>'


def read_collada(data):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.dae"
        path.write_bytes(data)
        return read_mesh(path)


def words(numbers):
    return " ".join(str(number) for number in np.ravel(numbers))


def triangles(faces=BOX.faces):
    return (
        f'<triangles count="{len(faces)}"><input semantic="VERTEX" source="#v" offset="0"/>'
        f"<p>{words(faces)}</p></triangles>"
    )


ARROW = [[2, 1, 0], [0, 2, 0], [1, 1, 0], [0, 0, 0]]
"""A quadrilateral with a notch at its third corner."""


def polygon(corners):
    return (
        triangles([corners])
        .replace("triangles", "polylist")
        .replace("<p>", "<vcount>4</vcount><p>")
    )


@pytest.mark.parametrize("first", range(4))
def test_a_polygon_is_read_where_its_fan_covers_it(tmp_path, first):
    """From its notch and from its tip; from the others the fan reaches out of it."""
    corners, rows = np.roll(np.arange(4), -first), "\n".join(map(words, ARROW))
    (tmp_path / "a.off").write_text(f"OFF\n4 1 0\n{rows}\n4 {words(corners)}\n")
    (tmp_path / "a.dae").write_bytes(collada(polygon(corners), points=ARROW))
    for path in tmp_path.iterdir():
        with pytest.raises(ValueError, match="notch") if first % 2 else nullcontext():
            assert trimesh.Trimesh(*read_mesh(path)).area == pytest.approx(1.0)


def collada(
    primitives=None, nodes=f'<node id="n">{PLACED}</node>', asset="", more="", points=BOX.vertices
):
    primitives = triangles() if primitives is None else primitives
    return f"""<?xml version="1.0" encoding="utf-8"?>
        <COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
        <asset>{asset}</asset>{more}
        <library_geometries><geometry id="g"><mesh>
          <source id="p"><float_array id="f" count="{np.size(points)}">{words(points)}</float_array>
            <technique_common><accessor source="#f" count="{len(points)}" stride="3">
              <param name="X" type="float"/><param name="Y" type="float"/>
              <param name="Z" type="float"/></accessor></technique_common></source>
          <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
          {primitives}
        </mesh></geometry></library_geometries>
        <library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
        <scene><instance_visual_scene url="#s"/></scene></COLLADA>""".encode()


def solid(data):
    vertices, faces = read_collada(data)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices()
    assert mesh.is_watertight
    return mesh


@pytest.mark.parametrize(
    ("nodes", "bounds"),
    [
        (
            "<node><translate>1 0 0</translate><node><rotate>0 0 1 90</rotate>"
            f"<scale>2 1 1</scale>{PLACED}</node></node>",
            ([0.97, -0.1, -0.02], [1.03, 0.1, 0.02]),
        ),
        (
            f"<node><matrix>0 0 1 0 0 1 0 0 -1 0 0 3 0 0 0 1</matrix>{PLACED}</node>",
            ([-0.02, -0.03, 2.95], [0.02, 0.03, 3.05]),
        ),
        (
            '<node><translate>0 5 0</translate><instance_node url="#m"/></node>',
            ([-0.05, 4.97, 0.98], [0.05, 5.03, 1.02]),
        ),
    ],
    ids=["nested", "matrix", "instance of a node"],
)
def test_nodes_place_what_they_hold(nodes, bounds):
    more = (
        f'<library_nodes><node id="m"><translate>0 0 1</translate>{PLACED}</node></library_nodes>'
    )
    mesh = solid(collada(nodes=nodes, more=more))
    np.testing.assert_allclose(mesh.bounds, bounds, atol=1e-6)
    assert mesh.volume > 0.0


def test_what_has_no_surface_may_be_nested_and_broken():
    more = "<extra><technique><extra><a/></extra></technique></extra>"
    broken = "<library_effects><b></library_effects>"
    assert len(solid(collada(more=more + broken)).faces) == 12


@pytest.mark.parametrize("axis", ["X_UP", "Y_UP", "Z_UP"])
def test_the_unit_counts_and_the_up_axis_does_not(axis):
    asset = f'<unit name="inch" meter="0.0254"/><up_axis>{axis}</up_axis>'
    moved = f"<node><translate>1 0 0</translate>{PLACED}</node>"
    mesh = solid(collada(nodes=moved, asset=asset))
    np.testing.assert_allclose(mesh.extents, 0.0254 * BOX.extents, rtol=1e-6)
    np.testing.assert_allclose(mesh.center_mass, [0.0254, 0, 0], atol=1e-7)


@pytest.mark.parametrize(
    "data",
    [
        b"<COLLADA>",
        b"<robot/>",
        collada(asset='<unit meter="0"/>'),
        collada(asset='<unit meter="a"/>'),
        collada(nodes='<node><instance_geometry url="#h"/></node>'),
        collada(nodes='<node><instance_geometry url="other.dae#g"/></node>'),
        collada(triangles([[0, 1, 8]])),
        collada(triangles([["a", 1, 2]])),
        collada(triangles().replace("VERTEX", "NORMAL")),
        collada().replace(b"mesh>", b"brep>"),
        collada(triangles() + "<polygons><ph><p>0 1 2</p><h>3 4 5</h></ph></polygons>"),
        collada(nodes=f'<node>{PLACED}<instance_controller url="#c"/></node>'),
        b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + collada()[40:],
    ],
)  # fmt: skip
def test_what_cannot_be_understood_is_refused_and_never_left_out(data):
    with pytest.raises(Exception):  # noqa: B017, PT011 - whatever loaders raise
        read_collada(data)
