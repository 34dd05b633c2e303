"""Each layer of docs/design.md imports only from those before it."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "placement_planner_ros"
PACKAGE = "placement_planner_ros"

# The rooms and loose files of core, each importing only from those before it.
ORDER = [
    "core.errors",
    "core.did_you_mean",
    "core.settings",
    "core.boxes",
    "core.types",
    "core.stopping",
    "core.child_process",
    "core.weak_cache",
    "core.disk_cache",
    "core.uncounted",
    "core.kernels",
    "core.measured_points",
    # libraries that each know one thing
    "core.scene",
    "core.body",
    "core.meshes",
    "core.robot",
    "core.motion",
    "core.search",
    "core.reach",
    "core.carry",
    "core.wishes",
    "core.objective",
    "core.collision",
    "core.swept",
    # what placing adds
    "core.problem",
    "core.contacts",
    "core.constraints",
    "core.grasp",
    # the paper's verbs
    "core.sample_goals",
    "core.plan_motion",
    "core.optimize_locally",
    "core.timing",
    # Algorithm 1
    "core.statistics",
    "core.explanation",
    "core.unseen_way",
    "core.planner",
    "core.warmup",
]
# The same of the node.
ROS_ORDER = [
    "ros.node_words",
    "ros.qos",
    "ros.patience",
    "ros.timers",
    "ros.call_priority",
    "ros.paced",
    "ros.spinning",
    "ros.process",
    "ros.log",
    "ros.parameters",
    "ros.inputs",
    "ros.run",
    "ros.outputs",
    "ros.commands",
    "ros.services",
    "ros.node",
    # beside the node, which they start as a process of its own
    "ros.tools",
]
ROS = {"rclpy", "ament_index_python", "builtin_interfaces", "tf2_ros"}


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(p for p in parts if p != "__init__")


def imports(path: Path) -> set[str]:
    """Absolute names of everything a file imports, `from a import b` as a and a.b."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module)
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def unit(module: str) -> str | None:
    """The layered unit that a module of the package belongs to."""
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] in ("core", "ros") and len(parts) > 1 else None


ADAPTER = sorted(set((ROOT / "ros").rglob("*.py")) - {ROOT / "ros" / "__init__.py"})
CORE = sorted((ROOT / "core").rglob("*.py"))
CLIENT = sorted((ROOT / "client").rglob("*.py"))
VIEW = sorted((ROOT / "view").rglob("*.py"))
DEMO = sorted((ROOT / "demo").rglob("*.py"))
KNOWS_ROS = {*(ROOT / "ros").rglob("*.py"), *CLIENT, *VIEW, *DEMO}
OUTSIDE_ROS = sorted(set(ROOT.rglob("*.py")) - KNOWS_ROS)
# The rooms of the package, each importing only from those before it.
ROOMS = ["core", "library", "scenes", "pictures", "ros", "client", "view", "demo"]


SEARCH_AND_MOTION = [p for p in CORE if p.parent.name in ("search", "motion")]


def is_ros(name: str) -> bool:
    top = name.split(".")[0]
    if f"{name}.".startswith(f"{PACKAGE}.ros."):
        return True
    return top in ROS or top.endswith(("_msgs", "_srvs", "_interfaces"))


def inside(path):
    """What a file imports of the package, without the package's name."""
    return {n.removeprefix(f"{PACKAGE}.") for n in imports(path) if n.startswith(f"{PACKAGE}.")}


def test_only_the_adapter_imports_ros():
    found = {module_name(path): {n for n in imports(path) if is_ros(n)} for path in OUTSIDE_ROS}
    assert not {module: names for module, names in found.items() if names}


@pytest.mark.parametrize(("files", "order"), [(CORE, ORDER), (ADAPTER, ROS_ORDER)])
def test_core_and_ros_import_only_from_layers_before(files, order):
    for path in files:
        own = unit(module_name(path))
        if own is None:
            continue
        assert own in order, f"{own} has no place: name it in its order and in docs/design.md"
        others = {unit(name) for name in inside(path)} - {own, None}
        others = {other for other in others if other in order or files is CORE}
        later = {other for other in others if order.index(other) >= order.index(own)}
        assert not later, f"{path} imports {later}"
        if files is CORE:
            above = {name for name in inside(path) if not name.startswith("core")}
            assert not above, f"{path} imports {above}, which is above core"
        assert own != "ros.tools" or not others & {"ros.commands", "ros.services", "ros.node"}


def test_the_client_knows_ros_and_nothing_of_the_planner():
    for path in CLIENT:
        others = {name for name in inside(path) if not name.startswith("client.")}
        parts = {".".join(name.split(".")[:2]) for name in others}
        assert parts <= {"ros.qos", "ros.spinning"}, path


def test_the_page_is_there_without_anything_compiled():
    code = "import sys, placement_planner_ros.view.command; sys.exit('numba' in sys.modules)"
    assert (
        subprocess.run([sys.executable, "-c", code], cwd=ROOT.parent, check=False).returncode == 0
    )


def test_rooms_import_only_from_rooms_before_and_nothing_from_beside_the_package():
    for path in sorted(ROOT.rglob("*.py")):
        own, names = module_name(path).split(".")[0], imports(path)
        if own in ROOMS:
            above = tuple(f"{PACKAGE}.{room}." for room in ROOMS[ROOMS.index(own) + 1 :])
            assert not [name for name in names if f"{name}.".startswith(above)], path
        beside = {name.split(".")[0] for name in names}
        assert not beside & {"benchmarks", "test", "examples"}, path


def test_search_and_motion_know_nothing_of_robots_nor_of_each_other():
    for path in SEARCH_AND_MOTION:
        allowed = {unit(module_name(path)), *ORDER[: ORDER.index("core.scene")]}
        if "search" in path.parts:
            allowed.add("core.scene")  # the regions that the hierarchy divides
        assert {unit(name) for name in inside(path)} <= allowed, path
