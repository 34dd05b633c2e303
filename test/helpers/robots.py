"""Small robots with joints and shapes of every kind."""

import trimesh

from placement_planner_ros.core.robot.model import Robot

LIMIT = '<limit lower="-1" upper="1" velocity="2" effort="1"/>'
SLIDING = """
<robot name="sliding">
  <link name="base"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="cart"/><link name="mast"/><link name="boom"/><link name="tip"/>
  <joint name="along" type="prismatic"><parent link="base"/><child link="cart"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.4 -0.2 0.9"/>
    <axis xyz="1 0 0"/><limit lower="-0.5" upper="1.0" velocity="1" effort="1"/></joint>
  <joint name="turn" type="revolute"><parent link="cart"/><child link="mast"/>
    <axis xyz="0.6 0 -0.8"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="reach" type="prismatic"><parent link="mast"/><child link="boom"/>
    <origin xyz="0 0.3 0"/>
    <axis xyz="0 -1 0"/><limit lower="0" upper="0.7" velocity="1" effort="1"/></joint>
  <joint name="roll" type="revolute"><parent link="boom"/><child link="tip"/>
    <origin xyz="0.2 0 0" rpy="0.3 0.5 0"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
</robot>
"""
"""Two joints that slide and two that turn, none along an axis of another."""


def _mixed_urdf(mesh_file):
    """Four joints, every kind of shape, a mesh that is not convex, and one that stands still."""
    return f"""
<robot name="mixed">
  <link name="base"><collision><origin xyz="0 0 -0.05"/>
    <geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <link name="post"><collision>
    <geometry><mesh filename="{mesh_file}" scale="1 1 4"/></geometry></collision></link>
  <joint name="stand" type="fixed"><parent link="base"/><child link="post"/>
    <origin xyz="-0.3 0 0.2"/></joint>
  <link name="upper"><collision><origin xyz="0 0 0.15"/>
    <geometry><cylinder radius="0.03" length="0.3"/></geometry></collision></link>
  <link name="fore"><collision><origin xyz="0.12 0 0"/>
    <geometry><box size="0.24 0.05 0.04"/></geometry></collision>
    <collision><origin xyz="0.24 0 0"/>
    <geometry><sphere radius="0.04"/></geometry></collision></link>
  <link name="ring"><collision><origin xyz="0.1 0 0"/>
    <geometry><mesh filename="{mesh_file}"/></geometry></collision></link>
  <link name="tip"/>
  <joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0.6 0 0.8"/>
    <limit lower="-2.5" upper="2.5" velocity="1" effort="1"/></joint>
  <joint name="j2" type="revolute"><parent link="upper"/><child link="fore"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.33"/><limit lower="-2.5" upper="2.5" velocity="1" effort="1"/></joint>
  <joint name="j3" type="prismatic"><parent link="fore"/><child link="ring"/><axis xyz="1 0 0"/>
    <origin xyz="0.3 0 0"/><limit lower="0" upper="0.2" velocity="1" effort="1"/></joint>
  <joint name="j4" type="revolute"><parent link="ring"/><child link="tip"/><axis xyz="1 0 0"/>
    <origin xyz="0.25 0 0"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
</robot>
"""


_MIXED_SRDF = """
<robot name="mixed">
  <disable_collisions link1="base" link2="upper" reason="Adjacent"/>
  <disable_collisions link1="upper" link2="fore" reason="Adjacent"/>
  <disable_collisions link1="fore" link2="ring" reason="Adjacent"/>
</robot>
"""


def ring_in(folder):
    """The address of a mesh that is not convex, in a folder (`Path`)."""
    file = folder / "ring.stl"
    trimesh.creation.torus(0.07, 0.015, major_sections=16, minor_sections=8).export(file)
    return file.as_uri()


def mixed_robot(ring):
    """The robot of `_mixed_urdf`."""
    return Robot.from_urdf(_mixed_urdf(ring), srdf=_MIXED_SRDF)


def link(name, inside=""):
    """The text of a link of a URDF."""
    return f'<link name="{name}">{inside}</link>'


def joint(name, parent, child, kind="revolute", xyz="0 0 0.3", limit=LIMIT, more="", origin=None):
    """The text of a joint of a URDF, about or along y, with an origin's place or all attributes."""
    origin = f'xyz="{xyz}"' if origin is None else origin
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin {origin}/><axis xyz="0 1 0"/>{limit or ""}{more}</joint>'
    )


def urdf(*elements, version="1.0"):
    """The text of a URDF."""
    return f'<robot name="test" version="{version}">{"".join(elements)}</robot>'
