"""After warming up a search compiles nothing more, and asks for no tables but those it has made."""

import subprocess
import sys
from pathlib import Path

import placement_planner_ros

PACKAGE = Path(placement_planner_ros.__file__).parent
# In a process of its own, as the other tests call kernels too. The arms' neutral configuration is
# the one that the node warms up with; that it lies within the limits, or free, is nowhere said.
PROGRAM = """
from dataclasses import replace

import numpy as np
import pinocchio as pin
from numba.core import event

from placement_planner_ros import Body, Environment, PlannerSettings
from placement_planner_ros.core.collision import pair_tables
from placement_planner_ros.core.objective.by_name import make_objective
from placement_planner_ros.core.objective.objective import ObjectiveContext
from placement_planner_ros.core.planner import PlacementPlanner
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.freespace import View
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.core.warmup.warm_up import warm_up
from placement_planner_ros.scenes.yumi import start_configuration
from placement_planner_ros.scenes.clouds import complete_cloud
from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.scenes import scene_by_name
from placement_planner_ros.scenes.yumi import load_yumi, yumi_arm

class Compiled(event.Listener):
    def on_start(self, told):
        compiled.append(told.data["dispatcher"].py_func.__name__)

    def on_end(self, told):
        pass


compiled = []
event.register("numba:compile", Compiled())

def recalled(kind, key, make):
    tables.append(key)
    return recall(kind, key, make)


tables, recall = [], pair_tables.recalled_result
pair_tables.recalled_result = recalled

robot = load_yumi()
arms = [yumi_arm(robot, name) for name in ("left", "right")]
warm_up(robot, arms, pin.neutral(robot.model))
compiled.clear()
made = {*tables}
held, scene = object_by_name("small_crayons_box"), scene_by_name("cabinet_high_clutter")
body = Body.from_mesh(held.vertices, held.triangles)
environment = Environment.from_points(complete_cloud(scene), scene.volume)
arms = tuple(replace(arm, grasps=tuple(held.grasps[arm.name])) for arm in arms)
q = robot.configuration(start_configuration("small_crayons_box"))
problem = Problem(robot, arms, q, body, scene.volume, environment)
context = ObjectiveContext(environment, scene.volume, body)
objective = make_objective("maximize_clearance", context)
for sampler in ("optimistic", "mcts"):
    settings = replace(PlannerSettings(), sampler=sampler)
    planner = PlacementPlanner(problem, objective, settings, np.random.default_rng(0))
    found = planner.run(lambda: planner.statistics.samples > 20_000)
    print(len([placement for placement, _ in zip(found, range(3))]))
# a surface with a gap that a camera sees through, as in a table of slats
x, y = np.mgrid[0.3:0.7:0.004, -0.2:0.2:0.004].reshape(2, -1)
points = np.column_stack([x, y, np.where(np.hypot(x - 0.5, y) < 0.02, -0.2, 0.0)])
volume, eye = TargetVolume([0.3, -0.2, -0.05], [0.7, 0.2, 0.3]), np.array([0.5, 0.0, 1.0])
pierced = Environment.from_points(points, volume, sights=[View(points, eye)])
print(int(pierced.support.supported(points, 0.003).sum()))
print(len(made), len({*tables} - made))
for name in compiled:
    print(name)
"""


def test_a_search_compiles_nothing_that_warming_up_has_not():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=PACKAGE.parent,
        capture_output=True,
        text=True,
        check=False,
        timeout=600.0,
    )
    assert done.returncode == 0, done.stderr
    found, more, gaps, tables, *unknown = done.stdout.splitlines()
    assert min(int(found), int(more)) >= 2, "this searched too little to tell"
    assert int(gaps) > 0
    made, others = map(int, tables.split())
    assert made > 4
    assert others == 0
    assert unknown == []
