"""What the checker is told of a search with the bundled YuMi."""

from dataclasses import replace

from checker import SolutionChecker, Task, Tolerances

from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.scenes.yumi import start_configuration
from placement_planner_ros.share import PACKAGE, share_path


def yumi_task(scene, thing, objective="none", **changes):
    """Of a `Scene` and a `GraspedObject`, from where the YuMi begins with that in its hands."""
    urdf = share_path("urdf", "yumi.urdf")
    task = Task.of(
        scene,
        thing,
        urdf=urdf.read_text(encoding="utf-8"),
        srdf=share_path("urdf", "yumi.srdf").read_text(encoding="utf-8"),
        package_dirs={PACKAGE: urdf.parent.parent},
        q_start=start_configuration(thing),
        objective=objective,
    )
    return replace(task, **changes)


def yumi_checker(task, **tolerances):
    """With the planner's own limit on accelerations."""
    limit = PlannerSettings().timing.acceleration_limits[0]
    return SolutionChecker(task, Tolerances(acceleration_limit=limit, **tolerances))
