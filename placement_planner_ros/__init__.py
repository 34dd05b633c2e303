"""Anytime placement planning for robot manipulators: a library, and a ROS 2 node around it.

The library in a few names, loaded when they are first asked for: `Robot`, `Body`, `TargetVolume`
and `Environment` are what is given, `plan` yields each `Placement` found. `PlannerSettings` says
how to search, and all errors for bad input are `PlacementPlannerError`s. `examples/library.py`
shows them together. `ros` is the adapter around them; nothing else imports ROS.

Where the symbols of Haustein et al., "Object Placement Planning and Optimization for Robot
Manipulators", live:

============================================  =============================================="""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from placement_planner_ros.core.body.body import Body
    from placement_planner_ros.core.errors import PlacementPlannerError
    from placement_planner_ros.core.planner import PlannerSettings
    from placement_planner_ros.core.robot.model import Robot
    from placement_planner_ros.core.scene.environment import Environment
    from placement_planner_ros.core.types import Placement, TargetVolume
    from placement_planner_ros.library import plan

__all__ = [
    "Body",
    "Environment",
    "Placement",
    "PlacementPlannerError",
    "PlannerSettings",
    "Robot",
    "TargetVolume",
    "plan",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.library"), name)
