"""Snapshots that differ in what was seen."""

from dataclasses import replace

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.ros.inputs.cloud_store import PointSet
from placement_planner_ros.ros.parameters.table import arm_specs, arms_spec, fixed_specs
from placement_planner_ros.ros.parameters.values import ParameterSet
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm


def parts_of(clouds, origins=None, placed=None):
    """Point sets, each seen from somewhere, or known."""
    origins = origins or (None,) * len(clouds)
    placed = placed or (False,) * len(clouds)
    return tuple(map(PointSet, clouds, origins, placed))


def seen(snapshot, clouds=None, origins=None, placed=None, **changes):
    """The same snapshot with other clouds, seen from elsewhere or known."""
    before = snapshot.parts
    return replace(
        snapshot,
        parts=parts_of(
            snapshot.clouds if clouds is None else clouds,
            tuple(part.origin for part in before) if origins is None else origins,
            tuple(part.placed for part in before) if placed is None else placed,
        ),
        **changes,
    )


def yumi_snapshot(arms, clouds, origins=None):
    """The bundled robot with a box in the hands of those arms, before clouds of a table."""
    held, robot = object_by_name("small_crayons_box"), load_yumi()
    specs = [*fixed_specs(), arms_spec(list(arms))]
    specs += [spec for arm in arms for spec in arm_specs(arm, yumi=True)]
    parameters = ParameterSet({spec.name: spec for spec in specs})
    return Snapshot(
        robot,
        tuple(yumi_arm(robot, arm, held.grasps[arm]) for arm in arms),
        robot.configuration(START_CONFIGURATION),
        Body.from_mesh(held.vertices, held.triangles, held.center_of_mass),
        parts_of(clouds, origins),
        parameters.changed({"target_volume": [0.2, -0.3, -0.1, 0.6, 0.3, 0.2], "seed": 3}),
        robot.root_link,
    )
