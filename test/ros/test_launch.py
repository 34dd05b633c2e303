"""Launch files and RViz's configuration: they name what the package has, and say what it is.

`launch` is on no package registry; stand-ins record what the files ask it for.
"""

import runpy
import sys
from pathlib import Path
from types import ModuleType

import pytest
import yaml

from placement_planner_ros.ros.tools.scene_publisher import FRAME
from placement_planner_ros.scenes.objects import BUNDLED_OBJECTS
from placement_planner_ros.scenes.scenes import BUNDLED_SCENES, CABINET_VOLUME, scene_by_name

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "launch").glob("*.launch.py"))
RVIZ = yaml.safe_load((ROOT / "config" / "placement_planner.rviz").read_text(encoding="utf-8"))


class Asked:
    """Anything that a launch file makes: remembers how."""

    def __init__(self, *positional, **named):
        self.positional, self.named = positional, named

    def perform(self, context):
        return context[self.positional[0]]


def kind(name):
    return type(name, (Asked,), {})


@pytest.fixture
def launch(monkeypatch):
    """Stand-ins for the modules that launch files import."""
    names = {
        "launch": ["LaunchDescription"],
        "launch.actions": [
            "DeclareLaunchArgument", "IncludeLaunchDescription", "LogInfo", "OpaqueFunction"
        ],
        "launch.launch_description_sources": ["PythonLaunchDescriptionSource"],
        "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
        "launch_ros.parameter_descriptions": ["ParameterValue"],
        "launch_ros.substitutions": ["FindPackageShare"],
        "ament_index_python.packages": [],
    }  # fmt: skip
    for module, kinds in names.items():
        made = ModuleType(module)
        for each in kinds:
            setattr(made, each, kind(each))
        monkeypatch.setitem(sys.modules, module, made)
    sys.modules["ament_index_python.packages"].get_package_share_directory = lambda package: ROOT


def described(path, context):
    """What a launch file asks for, functions of it called too."""
    found = []
    for asked in runpy.run_path(str(path))["generate_launch_description"]().positional[0]:
        if type(asked).__name__ == "OpaqueFunction":
            found += asked.named["function"](context)
        else:
            found.append(asked)
    return found


def of_kind(asked, name):
    return [each for each in asked if type(each).__name__ == name]


CONTEXT = {
    "scene": "table",
    "object": "wine_glass",
    "clouds": "cameras",
    "params_file": "mine.yaml",
}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_argument_is_described_and_every_program_is_there(path, launch):
    asked = described(path, CONTEXT)
    for argument in of_kind(asked, "DeclareLaunchArgument"):
        assert len(argument.named["description"]) > 20
        choices = argument.named.get("choices")
        assert choices is None or argument.named["default_value"] in choices
    for included in of_kind(asked, "IncludeLaunchDescription"):
        assert Path(included.positional[0].positional[0]).is_file()
    own = [n for n in of_kind(asked, "Node") if n.named["package"] == "placement_planner_ros"]
    for node in own:
        assert (ROOT / "resource" / "executables" / node.named["executable"]).is_file()
    manifest = (ROOT / "package.xml").read_text(encoding="utf-8")
    for node in of_kind(asked, "Node"):
        name = node.named["package"]
        assert node in own or f"<exec_depend>{name}</exec_depend>" in manifest


def arguments(path, launch):
    declared = of_kind(described(path, CONTEXT), "DeclareLaunchArgument")
    return {argument.positional[0]: argument.named for argument in declared}


def test_the_scene_offers_what_there_is(launch):
    found = arguments(ROOT / "launch" / "placement_scene.launch.py", launch)
    assert set(found["scene"]["choices"]) == set(BUNDLED_SCENES)
    assert set(found["object"]["choices"]) == set(BUNDLED_OBJECTS)
    # the node can be told of these alone
    assert all((ROOT / "config" / f"{name}.yaml").is_file() for name in BUNDLED_OBJECTS)


@pytest.mark.parametrize("scene", BUNDLED_SCENES)
@pytest.mark.parametrize("clouds", ["complete", "cameras"])
def test_the_node_is_told_of_the_scene_with_files_that_are_there(scene, clouds, launch):
    context = {"scene": scene, "object": "toy_table", "clouds": clouds, "params_file": ""}
    asked = described(ROOT / "launch" / "planner_and_scene.launch.py", context)
    (node,) = of_kind(asked, "Node")
    told = {}
    for file in node.named["parameters"]:
        told |= yaml.safe_load(Path(file).read_text(encoding="utf-8"))["/**"]["ros__parameters"]
    assert "vertices" in told["object"]
    volume = told.get("target_volume", [*CABINET_VOLUME.boxes.ravel()])
    assert volume == [*scene_by_name(scene).volume.boxes.ravel()]
    assert ("cloud_topics" in told) == (clouds == "cameras")


def test_rviz_shows_what_the_page_names():
    page = (ROOT / "docs" / "interface.md").read_text(encoding="utf-8")
    for display in RVIZ["Visualization Manager"]["Displays"]:
        topic = display.get("Topic") or display.get("Description Topic")
        if topic is not None:
            assert display["Enabled"]
            package, _, name = topic["Value"].removeprefix("/").partition("/")
            assert package != "placement_planner" or f"`~/{name}`" in page, name
    assert RVIZ["Visualization Manager"]["Global Options"]["Fixed Frame"] == FRAME
