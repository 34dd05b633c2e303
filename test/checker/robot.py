"""The robot rebuilt from its URDF text."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from .pieces import mesh_components
from .shapes import as_convex, mesh_of
from .task import Array


@dataclass(frozen=True)
class RobotModel:
    """The robot rebuilt from its URDF text."""

    model: pin.Model
    geometry: pin.GeometryModel
    index: dict[str, int]
    mimics: dict[str, tuple[str, float, float]]
    disabled: frozenset[frozenset[str]]
    pieces: Mapping[int, Sequence[tuple[Array, bool]]]
    """Of each geometry that is a mesh and not convex its connected components: (t, 3, 3) corners of
    triangles, and whether they close a solid; open ones are sheets."""

    @classmethod
    def read(cls, urdf: str, srdf: str, package_dirs: Mapping[str, str | Path]) -> RobotModel:
        """Meshes are in packages by name, or relative to the folder that `""` names."""
        root = ElementTree.fromstring(urdf)
        mimics = {}
        for joint in root.iter("joint"):
            name = str(joint.get("name"))
            if joint.get("type") == "continuous":  # one coordinate, as everywhere
                joint.set("type", "revolute")
                limit = joint.find("limit")
                limit = ElementTree.SubElement(joint, "limit") if limit is None else limit
                for key, value in {"lower": "-1e9", "upper": "1e9"}.items():
                    limit.set(key, value)
                for key in ("velocity", "effort"):
                    limit.set(key, limit.get(key) or "1e9")
            mimic = joint.find("mimic")
            if mimic is not None:
                factor = float(mimic.get("multiplier", "1"))
                mimics[name] = (str(mimic.get("joint")), factor, float(mimic.get("offset", "0")))
        for link in root.iter("link"):
            for collision in link.findall("collision"):
                if _is_point(collision):
                    link.remove(collision)
            for collision in link.findall("collision"):
                if collision.find("geometry/capsule") is not None:
                    link.remove(collision)
                    link.extend(_capsule(collision))
        for mesh in root.iter("mesh"):
            file = str(mesh.get("filename"))
            for package, folder in package_dirs.items():
                file = file.replace(f"package://{package}/", f"{folder}/")
            if "://" not in file:
                file = str(Path(package_dirs.get("", "")) / file)
            mesh.set("filename", file)
        text = ElementTree.tostring(root, encoding="unicode")
        model = pin.buildModelFromXML(text)
        geometry = pin.buildGeomFromUrdfString(model, text, pin.COLLISION)
        for thing in geometry.geometryObjects:
            thing.geometry = as_convex(thing.geometry)
        pairs = ElementTree.fromstring(srdf).iter("disable_collisions") if srdf else ()
        disabled = frozenset(frozenset({str(p.get("link1")), str(p.get("link2"))}) for p in pairs)
        index = {name: int(model.joints[i + 1].idx_q) for i, name in enumerate(model.names[1:])}
        pieces = {
            i: mesh_components(*mesh_of(thing.geometry))
            for i, thing in enumerate(geometry.geometryObjects)
            if isinstance(thing.geometry, coal.BVHModelBase)
        }
        return cls(model, geometry, index, mimics, disabled, pieces)

    def fill_mimics(self, states: Array) -> None:
        for name, (master, factor, offset) in self.mimics.items():
            states[:, self.index[name]] = factor * states[:, self.index[master]] + offset

    def configuration(self, positions: Mapping[str, float]) -> Array:
        q = np.zeros((1, self.model.nq))
        for name, column in self.index.items():
            if name not in self.mimics:
                q[0, column] = positions[name]
        self.fill_mimics(q)
        return np.asarray(q[0])

    def frame_pose(self, q: Array, frame: str) -> Array:
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, q)
        return np.array(data.oMf[self.model.getFrameId(frame)].homogeneous)

    def reach(self, object_vertices: Array) -> Array:
        """(nq,) most metres any point (the held object's included) moves per unit of a joint."""
        held = 2 * float(np.linalg.norm(object_vertices, axis=1).max()) + 0.2
        extent = np.full(self.model.njoints, held)
        for thing in self.geometry.geometryObjects:
            shape = thing.geometry
            shape.computeLocalAABB()
            centre = thing.placement.act(np.asarray(shape.aabb_center))
            size = float(np.linalg.norm(centre)) + float(shape.aabb_radius)
            extent[thing.parentJoint] = max(extent[thing.parentJoint], size)
        result = np.ones(self.model.nq)
        for joint in range(self.model.njoints - 1, 0, -1):
            parent = self.model.parents[joint]
            sliding = self.model.joints[joint].shortname().startswith("JointModelP")
            column = self.model.joints[joint].idx_q
            far = extent[joint]
            if sliding:
                far += abs(self.model.upperPositionLimit[column])
            else:
                result[column] = extent[joint]
            offset = float(np.linalg.norm(self.model.jointPlacements[joint].translation))
            extent[parent] = max(extent[parent], offset + far)
        return result


def _is_point(collision: ElementTree.Element) -> bool:
    """Whether a shape is a box, ball or cylinder all of whose sizes are 0: a mark, not a thing."""
    sizes = [
        float(size)
        for shape in collision.findall("geometry/*")
        for name in ("size", "radius", "length")
        for size in shape.get(name, "").split()
    ]
    return bool(sizes) and not any(sizes)


def _capsule(collision: ElementTree.Element) -> list[ElementTree.Element]:
    """A cylinder and two balls: what reads a URDF's text leaves capsules out, with a line."""
    shape = collision.find("geometry/capsule")
    assert shape is not None
    radius, length = str(shape.get("radius")), float(str(shape.get("length")))
    origin = collision.find("origin")
    at = {} if origin is None else origin.attrib
    xyz, rpy = (np.array(at.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy"))
    axis = pin.rpy.rpyToMatrix(*rpy)[:, 2]
    made = []
    for along, solid in (
        (0.0, {"cylinder": {"radius": radius, "length": str(length)}}),
        (0.5, {"sphere": {"radius": radius}}),
        (-0.5, {"sphere": {"radius": radius}}),
    ):
        part = ElementTree.Element("collision")
        place = " ".join(map(str, xyz + along * length * axis))
        ElementTree.SubElement(part, "origin", xyz=place, rpy=" ".join(map(str, rpy)))
        geometry = ElementTree.SubElement(part, "geometry")
        for name, sizes in solid.items():
            ElementTree.SubElement(geometry, name, sizes)
        made.append(part)
    return made
