"""Each layer of docs/design.md imports only from those before it."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "placement_planner_ros"
PACKAGE = "placement_planner_ros"

# Layer of each module or folder of core, by its path.
LAYERS = {
    "core.types": 0,
    "core.errors": 0,
    "core.lean": 0,
    "core.scene": 1,
    "core.body": 1,
    "core.robot": 1,
    "core.feasibility": 2,
    "core.objective": 2,
    "core.ascent": 2,
    "core.open_hand": 2,
    "core.holding": 2,
    "core.withdrawal": 2,
    "core.cell_bounds": 3,
    "core.search": 3,
    "core.motion": 3,
    "core.goals": 3,
    "core.transit": 3,
    "core.refine": 3,
    "core.execution": 3,
    "core.statistics": 3,
    "core.planner": 4,
    "core.warmup": 5,
}
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
    return ".".join(parts[:2]) if parts[0] == "core" and len(parts) > 1 else None


CORE = sorted((ROOT / "core").rglob("*.py"))
OUTSIDE_ROS = sorted(set(ROOT.rglob("*.py")) - set((ROOT / "ros").rglob("*.py")))


def is_ros(name: str) -> bool:
    top = name.split(".")[0]
    if f"{name}.".startswith(f"{PACKAGE}.ros."):
        return True
    return top in ROS or top.endswith(("_msgs", "_srvs", "_interfaces"))


@pytest.mark.parametrize("path", OUTSIDE_ROS, ids=module_name)
def test_only_the_adapter_imports_ros(path):
    assert not [name for name in imports(path) if is_ros(name)]


@pytest.mark.parametrize("path", CORE, ids=module_name)
def test_core_imports_only_from_layers_before(path):
    own = unit(module_name(path))
    if own is None:
        return
    assert own in LAYERS, f"{own} has no layer: name it in LAYERS and in docs/design.md"
    for name in imports(path):
        if not name.startswith(f"{PACKAGE}."):
            continue
        inside = name.removeprefix(f"{PACKAGE}.")
        assert inside.startswith("core"), f"{own} imports {inside}, which is above core"
        other = unit(inside)
        if other is not None and other != own:
            assert LAYERS[other] <= LAYERS[own], f"{own} imports {other}"


def test_search_and_motion_never_meet():
    for mine, other in (("search", "motion"), ("motion", "search")):
        for path in (ROOT / "core" / mine).rglob("*.py"):
            assert not [n for n in imports(path) if n.startswith(f"{PACKAGE}.core.{other}")]


def test_motion_and_the_search_tree_know_nothing_of_robots():
    paths = [*(ROOT / "core/motion").rglob("*.py"), ROOT / "core/search/tree.py"]
    for path in paths:
        assert not [n for n in imports(path) if n.startswith(f"{PACKAGE}.core.robot")], path


def test_the_package_itself_imports_nothing():
    assert imports(ROOT / "__init__.py") == set()
