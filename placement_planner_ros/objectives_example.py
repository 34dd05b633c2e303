"""An example of a user's objective: stand where it can be reached again.

Registered in setup.py under the entry-point group `placement_planner_ros.objectives`; any installed
package can register its own the same way.
"""

from __future__ import annotations

import pinocchio as pin

from placement_planner_ros.core.objective.objective import ObjectiveContext


class TowardFront:
    """ξ(x) = −(x_o − x_V): the nearer the object's centre of mass to V's near side, the better.

    The near side is that with the smallest x. It gives no gradient, so local optimisation
    differentiates it numerically.

    Args:
        context: environment, target volume and body of the run.
    """

    def __init__(self, context: ObjectiveContext) -> None:
        self._near_side = float(context.volume.lower[0])
        self._center_of_mass = context.body.center_of_mass

    def __call__(self, T_world_object: pin.SE3) -> float:
        """ξ(x), metres."""
        center = T_world_object.act(self._center_of_mass)
        return self._near_side - float(center[0])
