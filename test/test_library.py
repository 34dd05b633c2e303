"""The planner as a library: its facade, its table of the paper, and life without ROS."""

import functools
import importlib
import math
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh

import placement_planner_ros
from placement_planner_ros import (
    Body,
    CarrySettings,
    Environment,
    PlacementPlannerError,
    PlannerSettings,
    Robot,
    TargetVolume,
    TurnSettings,
    WishSettings,
    plan,
)
from placement_planner_ros.core.errors import VolumeError
from placement_planner_ros.scenes.yumi import START_CONFIGURATION, load_yumi, yumi_arm

ROOT = Path(__file__).parent.parent
PACKAGE = "placement_planner_ros"
NOT_OF_THE_CORE = ("rclpy", "ament_index_python", "ompl", "yaml", "dask", "mujoco")

# Python looks for modules as if the core alone were installed.
CORE_ALONE = f"""
import sys
from importlib.machinery import PathFinder

class CoreAlone(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        top = name.partition(".")[0]
        if top in {NOT_OF_THE_CORE} or top.endswith(("_msgs", "_srvs", "_interfaces")):
            return None
        return PathFinder.find_spec(name, path, target)

sys.meta_path[sys.meta_path.index(PathFinder)] = CoreAlone
"""


@pytest.fixture(scope="module")
def core_alone(tmp_path_factory):
    """Run Python elsewhere, with nothing installed but the core."""
    folder = tmp_path_factory.mktemp("core_alone")
    (folder / "sitecustomize.py").write_text(CORE_ALONE)
    paths = [str(folder), str(ROOT), os.environ.get("PYTHONPATH", "")]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}

    def run(*arguments):
        command = [sys.executable, *arguments]
        return subprocess.run(
            command, cwd=folder, env=env, capture_output=True, text=True, check=False
        )

    assert run("-c", "import rclpy").returncode != 0
    assert run("-c", "import std_msgs.msg").returncode != 0
    return run


def table_of_the_paper():
    rows = placement_planner_ros.__doc__.split("=\n")[2].splitlines()
    return [tuple(re.split(r"\s{2,}", row)) for row in rows if not row.startswith("=")]


@pytest.mark.parametrize("row", table_of_the_paper(), ids=lambda row: row[0])
def test_every_symbol_of_the_paper_lives_where_the_table_says(row):
    _, places = row
    for place in re.split(r"[,;] ", places):
        parts, rest = place.split("."), []
        while parts:
            try:
                found = importlib.import_module(".".join([PACKAGE, "core", *parts]))
                break
            except ModuleNotFoundError:
                rest.insert(0, parts.pop())
        assert parts, place
        for name in rest:
            found = getattr(found, name)


def test_the_table_names_what_the_paper_names():
    symbols = " ".join(symbol for symbol, _ in table_of_the_paper())
    for name in (
        *("Algorithm 1", "Algorithm 2", "Algorithm 3", "SampleGoals", "SelectAfrNode", "Sample;"),
        *("IKSolver", "Update", "PlanMotion", "OptimizeLocally", "Terminate", "UCB1", "H", "Δr(n)"),
        *("s(x)", "c_f(x)", "r(x)", "ξ(x)", "O(q)", "V", "C_free", "Ŝ(r, f)", "v(f)", "fT_o"),
        *("gT_o", "d_S", "B_o", "G_s", "M_s", "𝒢", "τ", "q_0", "g_max", "m_max", "ξ_best", "J†"),
        *("Ch(n)", "v(n)", "r(n)", "μ", "𝒮", "AFR hierarchy"),
    ):
        assert name in symbols


def test_importing_the_package_loads_nothing_until_a_name_is_used(core_alone):
    done = core_alone(
        "-c",
        "import sys, placement_planner_ros as p; assert 'numpy' not in sys.modules; "
        "assert p.plan and 'numpy' in sys.modules; print(*p.__all__)",
    )
    assert done.returncode == 0, done.stderr
    assert {"Robot", "Body", "Environment", "TargetVolume", "plan"} <= set(done.stdout.split())


def test_the_example_runs_without_ros(core_alone):
    done = core_alone(str(ROOT / "examples" / "library.py"))
    assert done.returncode == 0, done.stderr
    found = [float(value) for value in re.findall(r"objective (\S+),", done.stdout)]
    assert found
    assert len(found) == len(done.stdout.splitlines())
    assert found == sorted(set(found))


@pytest.mark.parametrize("program", ["planner", "demo --help", "scene"])
def test_programs_say_in_one_line_what_installs_what_they_lack(core_alone, program):
    done = core_alone("-m", PACKAGE, *f"placement_{program}".split())
    assert done.returncode != 0
    assert len(done.stderr.splitlines()) == 1
    assert f"pip install '{PACKAGE}[ros]'" in done.stderr


SIDE_EFFECTS = """
import ast, importlib, os, pkgutil, random, signal, sys, threading, warnings
import numba, numpy, placement_planner_ros

def state():
    return {
        "environment": dict(os.environ),
        "working folder": os.getcwd(),
        "signals": {n: signal.getsignal(n) for n in signal.valid_signals()},
        "warnings": (list(warnings.filters), warnings.showwarning),
        "random": (random.getstate(), repr(numpy.random.get_state())),
        "numba": {k: repr(getattr(numba.config, k)) for k in dir(numba.config) if k.isupper()},
        "interpreter": (sys.path[:], sys.meta_path[:], sys.excepthook, threading.excepthook),
        "limits": (sys.getswitchinterval(), sys.getrecursionlimit()),
        "threads": threading.active_count(),
    }

package = "placement_planner_ros."
names = [module.name for module in pkgutil.walk_packages(placement_planner_ros.__path__, package)]
assert len(names) > 100
for name in names:  # what other packages do is not asked: they are loaded first
    for node in ast.walk(ast.parse(open(importlib.util.find_spec(name).origin).read())):
        found = [node.module] if isinstance(node, ast.ImportFrom) else []
        found += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        for other in found:
            if not (other + ".").startswith(package):
                importlib.import_module(other)
before = state()
for name in names:
    importlib.import_module(name)
for key, value in state().items():
    assert before[key] == value, (key, before[key], value)
"""


def test_importing_changes_nothing_for_the_rest_of_the_process():
    done = subprocess.run(
        [sys.executable, "-c", SIDE_EFFECTS], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


GRASP = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.145]))
VOLUME = TargetVolume(np.array([0.3, 0.0, -0.05]), np.array([0.5, 0.3, 0.15]))


@functools.cache
def given():
    """A box in the YuMi's left hand, and an empty table."""
    robot = load_yumi()
    box = trimesh.creation.box((0.021, 0.071, 0.094))
    table = np.meshgrid(np.arange(0.25, 0.6, 0.005), np.arange(-0.1, 0.4, 0.005), 0.0)
    return {
        "robot": robot,
        "arms": yumi_arm(robot, "left", [GRASP]),
        "q_start": {**START_CONFIGURATION, "gripper_l_joint": 0.0105},
        "body": Body.from_mesh(box.vertices, box.faces),
        "volume": VOLUME,
        "environment": np.stack(table, axis=-1).reshape(-1, 3),
    }


def asked(**changed):
    return plan(**{**given(), "time_limit": 60.0, **changed})


def to_the_left(T_world_object):
    return float(T_world_object.translation[1])


def same(a, b):
    return a.objective == b.objective and (
        np.array_equal(a.trajectory.positions, b.trajectory.positions)
    )


def test_plan_yields_better_and_better_placements_until_it_is_closed():
    found = asked(objective=to_the_left, time_limit=math.inf, seed=3)
    first, second = next(found), next(found)
    assert second.objective > first.objective
    arm = given()["arms"]
    for placement in (first, second):
        assert VOLUME.contains(placement.T_world_object.translation[None]).all()
        q_start = given()["robot"].configuration(given()["q_start"])
        assert placement.trajectory.positions[0] == pytest.approx(q_start[arm.q_index])
    found.close()
    assert next(found, None) is None


def test_the_seed_fixes_the_result_however_the_input_is_written():
    first = next(asked(seed=3))
    others = {
        "arms": [given()["arms"]],
        "q_start": given()["robot"].configuration(given()["q_start"]).tolist(),
        "environment": given()["environment"].tolist(),
    }
    assert same(first, next(asked(seed=3, **others)))
    assert not same(first, next(asked(seed=4)))


def test_a_prepared_environment_and_any_callable_as_objective():
    environment = Environment.from_points(given()["environment"], VOLUME)
    placement = next(asked(environment=environment, objective=to_the_left))
    assert placement.objective == pytest.approx(placement.T_world_object.translation[1])
    larger = TargetVolume(VOLUME.lower - 0.01, VOLUME.upper)
    with pytest.raises(VolumeError, match=r"^volume = .*: the environment is of"):
        asked(environment=environment, volume=larger)


def test_rules_wishes_and_carrying_are_settings():
    up, near = [0.0, 0.0, -1.0], [0.4, 0.1, 0.05, 0.0, 0.0, 0.0, 1.0]
    settings = PlannerSettings(
        turns=TurnSettings(up=up),
        wishes=WishSettings(["near", "edge"], np.array([1.0, 0.5]), near, ["edge"], [0.02]),
    )
    free, slow = (
        next(asked(objective="weighted", settings=replace(settings, carry=carry), seed=1))
        for carry in (CarrySettings(), CarrySettings(max_acceleration=0.1))
    )
    T, terms = free.T_world_object, dict(free.terms)
    assert T.rotation @ up == pytest.approx([0.0, 0.0, 1.0], abs=1e-3)
    assert terms["near"] == pytest.approx(-np.linalg.norm(T.translation - near[:3]))
    assert terms["edge"] >= 0.02
    assert free.objective == pytest.approx(terms["near"] / 0.1 + 0.5 * terms["edge"] / 0.05)
    assert slow.trajectory.duration > 1.5 * free.trajectory.duration
    with pytest.raises(PlacementPlannerError, match=r"`up` is 118.3° .* `max_tilt`"):
        asked(settings=replace(settings, carry=CarrySettings(max_tilt=0.5)))


UP = np.array([0.0, 0.0, 0.3])
BALL = trimesh.creation.icosphere(subdivisions=2, radius=0.02)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"time_limit": 1e-9}, "no sample was tried"),
        ({"environment": np.zeros((0, 3))}, "no placement region: the cloud is empty, or"),
        ({"volume": TargetVolume(VOLUME.lower + UP, VOLUME.upper + UP)}, "no placement region"),
        ({"body": Body.from_mesh(BALL.vertices, BALL.faces)}, "no placement face"),
    ],
    ids=["no time", "no points", "no region", "no face"],
)
def test_why_nothing_was_found_is_logged(caplog, changed, why):
    assert list(asked(**changed)) == []
    assert f"no placement: {why}" in caplog.text


def test_what_is_left_out_is_logged(caplog):
    asked(arms=yumi_arm(given()["robot"], "left", [GRASP, pin.SE3.Identity()]))
    assert "left out: " in caplog.text
    assert "grasps[1]" in caplog.text


@pytest.mark.parametrize(
    ("name", "value", "field"),
    [
        ("arms", (), "arms"),
        ("arms", "left", "arms"),
        ("time_limt", 3.0, "time_limt"),
        ("robot", None, "robot"),
        ("body", trimesh.creation.box((0.02, 0.07, 0.09)), "body"),
        ("volume", ([0.3, 0.0, -0.05], [0.5, 0.3, 0.15]), "volume"),
        ("settings", {"sampler": "mcts"}, "settings"),
        ("q_start", dict.fromkeys(START_CONFIGURATION, "a"), "`q_start`: values"),
        ("q_start", {}, "`q_start`: missing"),
        ("q_start", [0.0] * 3, "q_start"),
        ("environment", np.zeros((5, 2)), "points.shape"),
        ("environment", np.full((5, 3), math.nan), "points"),
        ("objective", "be_nice", "objective"),
        ("time_limit", 0.0, "time_limit"),
        ("seed", -1, "seed"),
    ],
)
def test_bad_input_is_refused_at_once(name, value, field):
    with pytest.raises(PlacementPlannerError) as refused:
        asked(**{name: value})
    assert refused.value.field == field
    assert refused.value.remedy


@pytest.mark.parametrize("description", [ROOT, "/robots/mine.urdf"])
def test_a_path_for_a_description_is_told_from_its_text(description):
    with pytest.raises(PlacementPlannerError, match="give the text of the file"):
        Robot.from_urdf(description)
