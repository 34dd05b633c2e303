"""An objective of one's own: stand close to a point, the long side not into the shelf.

Run as it stands it uses the library. The node takes it by name once a package of yours that has
this module is installed with an entry point, here in its pyproject.toml:

    [project.entry-points."placement_planner_ros.objectives"]
    near_point = "own_objective:NearPoint"

Then `objective: near_point` in its parameters, or in those of one run.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from placement_planner_ros import Body, Environment, plan
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm

POINT = np.array([0.55, -0.05])
"""m, x and y in the planning frame."""
PER_RADIAN = 0.05
"""m of distance that count as much as a radian of turning."""


class NearPoint:
    """ξ(x) = −‖p(x) − POINT‖ − PER_RADIAN · turn(x): larger is better, any finite number will do.

    It is made once per run, and then asked of a great many poses: do what takes long here.

    Args:
        context: environment, target volume and body of the run.
    """

    def __init__(self, context: ObjectiveContext) -> None:
        self._center_of_mass = context.body.center_of_mass
        size = np.ptp(context.body.vertices, axis=0)
        self._long_side = np.eye(3)[int(np.argmax(size))]

    def __call__(self, T_world_object: pin.SE3) -> float:
        """ξ of that pose of the object in the planning frame."""
        away = np.linalg.norm(T_world_object.act(self._center_of_mass)[:2] - POINT)
        along = T_world_object.rotation @ self._long_side
        turn = np.arctan2(abs(along[0]), np.hypot(along[1], along[2]))  # out of x = 0
        return -float(away + PER_RADIAN * turn)


def main() -> None:
    """Place the bundled box by that objective."""
    robot, box = load_yumi(), object_by_name("small_crayons_box")
    arm = yumi_arm(robot, "left", box.grasps["left"])
    body = Body.from_mesh(box.vertices, box.triangles)
    scene = scene_by_name("cabinet_high_clutter")
    volume = scene.volume
    points, start = complete_cloud(scene), {**START_CONFIGURATION, "gripper_l_joint": 0.0105}
    known = Environment.from_points(points, volume, bounds=(points.min(axis=0), points.max(axis=0)))
    near = NearPoint(ObjectiveContext(known, volume, body))
    for placement in plan(
        robot, arm, start, body, volume, known, objective=near, time_limit=5.0, seed=1
    ):
        x, y, z = placement.T_world_object.translation
        print(f"at {x:.3f} {y:.3f} {z:.3f}: objective {placement.objective:.4f}")


if __name__ == "__main__":
    main()
