"""Installs the package into scratch prefixes, by pip and by colcon, and looks at what is there."""

import ast
import os
import re
import runpy
import shutil
import stat
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import setuptools
import yaml

ROOT = Path(__file__).parent.parent
PACKAGE = "placement_planner_ros"
EXECUTABLES = (
    "placement_planner",
    "placement_demo",
    "placement_scene",
    "placement_check_robot",
    "placement_view",
)
SHIPPED = ("config", "launch", "urdf")


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A copy of the sources, so that building leaves nothing behind in the checkout."""
    copy = tmp_path_factory.mktemp("workspace") / PACKAGE
    copy.mkdir()
    for name in (PACKAGE, "resource", *SHIPPED):
        shutil.copytree(
            ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__", "*.pyc")
        )
    for name in ("setup.py", "setup.cfg", "package.xml", "pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, copy / name)
    return copy


def run(command, **options):
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module", params=["pip", "colcon", "colcon --symlink-install"])
def prefix(request, source, tmp_path_factory):
    """An installation prefix that holds the package."""
    if request.param == "pip":
        prefix = tmp_path_factory.mktemp("pip")
        options = ["--ignore-installed", "--no-deps", "--no-build-isolation", "--quiet"]
        run(
            [sys.executable, "-m", "pip", "install", *options, "--prefix", str(prefix), str(source)]
        )
        return prefix
    colcon = Path(sys.executable).with_name("colcon")
    if not colcon.exists():
        pytest.skip("colcon is not installed")
    base = tmp_path_factory.mktemp("colcon")
    build = [f"--{kind}-base={base / kind}" for kind in ("build", "install")]
    run(
        [str(colcon), f"--log-base={base / 'log'}", "build", *build, *request.param.split()[1:]],
        cwd=source.parent,
        env={**os.environ, "PATH": f"{colcon.parent}{os.pathsep}{os.environ['PATH']}"},
    )
    return base / "install" / PACKAGE


def site_packages(prefix):
    """Where Python finds the package: in the prefix, or, with symlinks, where colcon points to."""
    found = list(prefix.glob("lib/python3*/site-packages"))
    assert len(found) == 1
    return found[0]


def test_the_index_knows_the_package(prefix):
    marker = prefix / "share/ament_index/resource_index/packages" / PACKAGE
    assert marker.is_file()
    assert (prefix / "share" / PACKAGE / "package.xml").is_file()


def test_every_shipped_file_is_under_share(prefix):
    for folder in SHIPPED:
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                installed = prefix / "share" / PACKAGE / path.relative_to(ROOT)
                assert installed.read_bytes() == path.read_bytes()


def test_every_executable_is_where_ros2_run_looks(prefix):
    folder = prefix / "lib" / PACKAGE
    names = {p.name for p in folder.iterdir() if p.is_file() and p.stat().st_mode & stat.S_IXUSR}
    assert names == set(EXECUTABLES)


def test_executables_run_and_import_what_was_installed(prefix):
    name = "placement_demo"
    python_path = [str(site_packages(prefix)), *_eggs(prefix), *sys.path]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, python_path))}
    env["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{env['PATH']}"
    said = run([str(prefix / "lib" / PACKAGE / name), "--help"], cwd=prefix, env=env)
    assert said.startswith(f"usage: {name}")


def _eggs(prefix):
    """Folders that colcon adds with --symlink-install."""
    hooks = prefix / "share" / PACKAGE / "hook"
    build = prefix.parent.parent / "build" / PACKAGE
    return [str(build)] if hooks.is_dir() and build.is_dir() else []


def test_all_sub_packages_are_installed(prefix):
    places = [site_packages(prefix), *map(Path, _eggs(prefix))]
    for path in [*(ROOT / PACKAGE).rglob("*.py"), ROOT / PACKAGE / "py.typed"]:
        inside = path.relative_to(ROOT)
        assert any((place / inside).is_file() for place in places), inside


def test_entry_points_are_registered(prefix):
    texts = [
        path.read_text()
        for place in [site_packages(prefix), *map(Path, _eggs(prefix))]
        for path in place.glob("*/entry_points.txt")
    ]
    assert any("toward_front" in text for text in texts)
    for name in EXECUTABLES:
        assert any(f"{name} = {PACKAGE}.__main__:{name}" in text for text in texts)


def test_versions_agree(keywords):
    version = ET.parse(ROOT / "package.xml").findtext("version")
    assert keywords["version"] == version
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == version
    newest = re.search(r"^## \[([\d.]+)\]", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert newest[1] == version


PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def test_links_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8")):
            assert "://" in target or (page.parent / target).exists(), (page, target)


@pytest.fixture
def keywords(monkeypatch):
    """What setup.py hands to setuptools."""
    given = {}
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(setuptools, "setup", lambda **keywords: given.update(keywords))
    runpy.run_path("setup.py")
    return given


@pytest.fixture
def requirements(keywords):
    """Extra ('' for the core) -> its requirements."""
    return {"": keywords["install_requires"], **keywords["extras_require"]}


def test_every_version_has_a_floor_and_a_ceiling(requirements):
    for name in {name for extra in requirements.values() for name in extra}:
        assert re.fullmatch(r"[\w.\[\]-]+>=[\d.]+,<[\d.]+( ;.*)?", name), name


def test_only_the_extra_ros_asks_for_ros_and_test_asks_for_all(requirements):
    assert not [name for name in requirements[""] if name.startswith("ros-")]
    assert any(name.startswith("ros-jazzy-rclpy") for name in requirements["ros"])
    extras = ("ros", "benchmarks", "view")
    assert {name for extra in extras for name in requirements[extra]} <= set(requirements["test"])


MODULES = {"pin": {"pinocchio"}, "pillow": {"PIL"}, "pyyaml": {"yaml"}, "pycollada": {"collada"}}
MODULES["numba"] = {"numba", "llvmlite"}  # which it is made of, and asks for itself
ROS_MODULES = {"rclpy", "ament_index_python", "builtin_interfaces", "rcl_interfaces"}
ROS_MODULES |= {f"{name}_msgs" for name in ("std", "geometry", "sensor", "shape", "trajectory")}
ROS_MODULES |= {"visualization_msgs", "diagnostic_msgs", "std_srvs"}
TF = {"tf2_ros", "tf2_msgs", "launch", "launch_ros"}  # looked up where they are installed


def imported(path):
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    return {name.split(".")[0] for name in names} - set(sys.stdlib_module_names) - {PACKAGE}


EXTRAS = {"ros": ["ros"], "client": ["ros"], "pictures": ["ros"], "demo": ["ros"]}
EXTRAS["view"] = ["ros", "view"]


def test_every_import_is_of_a_package_that_is_asked_for(requirements):
    for path in sorted((ROOT / PACKAGE).rglob("*.py")):
        extras = ["", *EXTRAS.get(path.relative_to(ROOT / PACKAGE).parts[0], [])]
        asked = [name for extra in extras for name in requirements[extra]]
        names = {re.match(r"[\w-]+", name)[0].lower() for name in asked}
        modules = {module for name in names for module in MODULES.get(name, {name})}
        if "ros-jazzy-rclpy" in names:
            modules |= ROS_MODULES | TF
        assert imported(path) <= modules, path
