"""What in a description is robot, and what is furniture."""

import gc
import weakref

import numpy as np
import pytest

from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.ros.inputs.furniture import fixed_links


def link(name, size="", xyz="0 0 0"):
    shape = f'<box size="{size}"/>'
    collision = f'<collision><origin xyz="{xyz}"/><geometry>{shape}</geometry></collision>'
    return f'<link name="{name}">{collision if size else ""}</link>'


def joint(parent, child, xyz="0 0 0", kind="fixed"):
    limit = '<axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/>'
    return (
        f'<joint name="{child}_joint" type="{kind}">'
        f'<parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/>{"" if kind == "fixed" else limit}</joint>'
    )


CELL = "".join(
    [
        '<robot name="cell">',
        link("world"),
        link("table", "1 1 0.02", "0 0 -0.01"),
        joint("world", "table"),
        link("base", "0.2 0.2 0.3", "0 0 0.15"),
        joint("world", "base"),
        link("plinth", "0.3 0.3 0.05", "0 0 0.02"),
        joint("world", "plinth"),
        link("collar", "0.06 0.06 0.02", "0 0 0.33"),
        joint("world", "collar"),
        link("shelf", "0.3 0.3 0.02", "0.4 0.4 0.5"),
        joint("world", "shelf"),
        link("lower", "0.08 0.08 0.4", "0 0 0.2"),
        joint("base", "lower", "0 0 0.31", "revolute"),
        link("upper", "0.05 0.05 0.3", "0 0.2 0"),
        joint("lower", "upper", "0 0 0.45", "revolute"),
        link("tip"),
        joint("upper", "tip", "0 0.4 0"),
        link("mast", "0.05 0.05 0.5", "-0.4 0 0.25"),
        joint("table", "mast"),
        link("head", "0.1 0.1 0.05", "0 0 0.06"),
        joint("mast", "head", "-0.4 0 0.5", "revolute"),
        "</robot>",
    ]
)


@pytest.fixture(scope="module")
def cell():
    return Robot.from_urdf(CELL)


def test_the_foot_carries_the_first_joint_or_is_always_touched(cell):
    found = fixed_links(cell, ("tip",))
    assert set(found.foot) == {"base", "plinth", "collar"}
    assert set(found.furniture) == {"table", "shelf", "mast"}
    for name in (*found.furniture, *found.foot):
        assert name in str(found)


def test_what_carries_a_sensor_is_no_furniture(cell):
    assert set(fixed_links(cell, ("tip", "head")).furniture) == {"table", "shelf"}


def test_furniture_may_be_named_instead(cell):
    assert fixed_links(cell, ("tip",), ("plinth",)).furniture == ("plinth",)


def test_furniture_is_part_of_the_surroundings_where_it_is_and_no_more_of_the_robot(cell):
    found = fixed_links(cell, ("tip",), ("shelf",))
    shelf = found.surfaces[0].within(np.full(3, -2.0), np.full(3, 2.0))
    assert shelf.placed
    low, high = shelf.points.min(axis=0), shelf.points.max(axis=0)
    assert np.allclose([low, high], [[0.25, 0.25, 0.49], [0.55, 0.55, 0.51]])
    assert "shelf" not in found.robot.geometry_links
    names = [thing.name for thing in found.robot.geometry.geometryObjects]
    assert len(names) == len(found.robot.meshes) == len(cell.geometry_links) - 1
    assert fixed_links(cell, ("tip",), ("shelf",)).robot is found.robot, "made once"
    pairs = {
        frozenset(found.robot.geometry_links[i] for i in (pair.first, pair.second))
        for pair in found.robot.geometry.collisionPairs
    }
    before = {
        frozenset(cell.geometry_links[i] for i in (pair.first, pair.second))
        for pair in cell.geometry.collisionPairs
    }
    assert pairs == {pair for pair in before if "shelf" not in pair}


@pytest.mark.parametrize("named", [("shelf",), ("nothing",)])
def test_a_robot_that_was_replaced_is_kept_by_nobody(named):
    robot = Robot.from_urdf(CELL)
    fixed_links(robot, ("tip",), named)
    known = weakref.ref(robot)
    del robot
    gc.collect()
    assert known() is None
