"""Several things put down one after the other, each planned around those before it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from placement_planner_ros.client import PlacementClient, PlacementError, Solution
from placement_planner_ros.demo.processes import DemoError
from placement_planner_ros.demo.search import BUSY, PAGE, search
from placement_planner_ros.progress import ProgressLine
from placement_planner_ros.ros.tools.scene_publisher import ScenePublisher
from placement_planner_ros.scenes.objects import GraspedObject, object_by_name
from placement_planner_ros.scenes.yumi import start_configuration

THINGS = ("large_crayons_box", "small_crayons_box", "toy_table", "wine_glass")
"""What is put down, in this order."""
_UPRIGHT = ("toy_table", "wine_glass")
"""Those that people would not put on their heads."""


@dataclass(slots=True, eq=False)
class Tour:
    """What it takes to put things down.

    Attributes:
        planner: of a node that is ready.
        publisher: of the scene, and of where the robot is.
        seconds: to search for with each thing.
        check: raises where node or publisher have died.
        line: what is told meanwhile.
    """

    planner: PlacementClient
    publisher: ScenePublisher
    seconds: float
    check: Callable[[], None]
    line: ProgressLine

    def put_down(self, name: str) -> list[Solution]:
        """Plan for a bundled thing, and tell the node that it stands there; each solution found.

        Raises:
            DemoError: no placement was found, or the node does not answer.
        """
        # the fingers close on another thing
        self.publisher.show(start_configuration(name), at_rest=True)
        given = parameters_of(object_by_name(name))
        found = search(self.planner, given, self.seconds, self.check, self.line)
        # as an executive asks before it moves
        still = self.planner.validity(found[-1])
        if not still:
            raise DemoError(f"the placement of {name} does not hold any more: {still.reason}", BUSY)
        try:
            self.planner.confirm_placed(found[-1])
        except PlacementError as error:
            self.check()
            raise DemoError(f"the node refuses what was put down: {error}", PAGE) from error
        return found


def parameters_of(held: GraspedObject) -> dict[str, Any]:
    """What the node has to know of a thing."""
    up = {"object.up": [0.0, 0.0, 1.0]} if held.name in _UPRIGHT else {}
    # poses one after the other, seven numbers each
    grasps = {
        f"{arm}.grasps": np.ravel([pin.SE3ToXYZQUAT(T) for T in grasps])
        for arm, grasps in held.grasps.items()
    }
    return {
        "object.vertices": held.vertices.ravel(),
        "object.triangles": held.triangles.ravel(),
        "object.center_of_mass": held.center_of_mass,
        **up,
        **grasps,
    }
