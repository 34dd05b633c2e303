"""What rclpy keeps to itself: neither used nor overwritten."""

import ast
from pathlib import Path

from rclpy.executors import Executor
from rclpy.node import Node

import placement_planner_ros
from placement_planner_ros.ros.parameters.server import ParameterNode

ROS = Path(placement_planner_ros.__file__).parent / "ros"
FILES = sorted(ROS.rglob("*.py"))


def is_private(name):
    return name.startswith("_") and not name.startswith("__")


def defined(tree):
    """Private names that a file gives to its own functions, classes, fields and attributes."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            names.add(node.attr)
    return {name for name in names if is_private(name)}


def own_attributes(tree, base):
    """What classes derived from that one keep in attributes or methods."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and any(
            isinstance(each, ast.Name) and each.id == base for each in node.bases
        ):
            yield node.name, defined(node)


def test_what_is_derived_from_rclpy_overwrites_nothing_private(ros):
    node, derived, executor = Node("any"), ParameterNode("other"), Executor()
    theirs = {
        "Node": {*vars(node), *dir(node)},
        "ParameterNode": {*vars(derived), *dir(derived)},
        "Executor": {*vars(executor), *dir(executor)},
    }
    executor.shutdown()
    node.destroy_node()
    derived.destroy_node()
    found = []
    for file in FILES:
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for base, names in theirs.items():
            for name, mine in own_attributes(tree, base):
                found.append(name)
                assert mine & names == set(), name
    assert {"PlacementPlannerNode", "ParameterNode", "PooledExecutor"} <= set(found)
