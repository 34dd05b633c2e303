"""Files named by users: where they are looked for, and who may name which."""

import os

import pytest

from placement_planner_ros.core.errors import RobotError
from placement_planner_ros.ros.inputs.resources import Files, description_text


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """An installed package, a folder of packages, an open folder, and a secret."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    index = tmp_path / "install/share/ament_index/resource_index/packages"
    for folder in (
        index,
        tmp_path / "install/share/installed",
        tmp_path / "packages/mine/meshes",
        tmp_path / "open",
        tmp_path / "secret",
    ):
        folder.mkdir(parents=True)
    (index / "installed").touch()
    for file in (
        "install/share/installed/a.stl",
        "packages/mine/meshes/b.stl",
        "packages/mine/robot.urdf",
        "open/c.stl",
        "secret/d.stl",
    ):
        (tmp_path / file).write_text("x")
    (tmp_path / "open/link.stl").symlink_to(tmp_path / "secret/d.stl")
    (tmp_path / "open/gone.stl").symlink_to(tmp_path / "secret/none.stl")
    (tmp_path / "open/folder").symlink_to(tmp_path / "secret")
    (tmp_path / "install/share/installed/built.stl").symlink_to(tmp_path / "secret/d.stl")
    (tmp_path / "secret/built").mkdir()
    (tmp_path / "install/share/installed/folder").symlink_to(tmp_path / "secret/built")
    return tmp_path


@pytest.fixture
def files(tree):
    return Files([str(tree / "packages")], ["open"])


@pytest.mark.parametrize(
    ("uri", "found"),
    [
        ("package://installed/a.stl", "install/share/installed/a.stl"),
        ("package://installed/built.stl", "install/share/installed/built.stl"),
        ("package://mine/meshes/b.stl", "packages/mine/meshes/b.stl"),
        ("{tree}/open/c.stl", "open/c.stl"),
        ("file://{tree}/open/c.stl", "open/c.stl"),
        ("c.stl", "open/c.stl"),
    ],
)
def test_what_lies_in_open_folders_may_be_named_by_anybody(files, tree, uri, found):
    path = files.find(uri.format(tree=tree), trusted=False)
    assert os.path.samefile(path, tree / found)


OUTSIDE = [
    ("{tree}/secret/{name}", "d.stl", "none.stl"),
    ("{tree}/open/../secret/{name}", "d.stl", "none.stl"),
    ("{tree}/open/folder/{name}", "d.stl", "none.stl"),
    ("{tree}/open/{name}", "link.stl", "gone.stl"),
    ("{tree}/install/share/installed/../../../secret/{name}", "d.stl", "none.stl"),
    ("package://installed/../../../secret/{name}", "d.stl", "none.stl"),
    ("package://installed/folder/../{name}", "d.stl", "none.stl"),
    ("package://%2e%2e/secret/{name}", "d.stl", "none.stl"),
    ("/{name}", "etc/passwd", "etc/none"),
    ("{name}", "~root/x", "~nobody-at-all/x"),
    ("/proc/self/{name}", "cmdline", "none"),
]


@pytest.mark.parametrize(("uri", "there", "missing"), OUTSIDE)
def test_elsewhere_the_answer_is_the_same_whether_there_is_a_file(files, tree, uri, there, missing):
    said = []
    for name in (there, missing):
        with pytest.raises(FileNotFoundError) as error:
            files.find(uri.format(tree=tree, name=name), trusted=False)
        said.append(str(error.value).replace(name, "*"))
    assert said[0] == said[1]


def test_the_operator_may_name_everything(files, tree):
    for uri in ("secret/d.stl", f"{tree}/open/link.stl", f"{tree}/open/../secret/d.stl"):
        assert files.find(uri, trusted=True).samefile(tree / "secret/d.stl")


def test_paths_count_from_the_urdf_file_and_packages_are_those_above_it(tree):
    urdf = tree / "packages/mine/robot.urdf"
    files = Files()
    for uri in ("meshes/b.stl", "package://mine/meshes/b.stl"):
        assert files.find(uri, trusted=True, beside=urdf).samefile(urdf.parent / "meshes/b.stl")
    with pytest.raises(FileNotFoundError):
        files.find("package://mine/meshes/b.stl", trusted=True)


def test_a_missing_package_names_every_folder_tried(files, tree):
    urdf = tree / "open/robot.urdf"
    with pytest.raises(FileNotFoundError) as error:
        files.find("package://other/m.stl", trusted=True, beside=urdf)
    for folder in (tree / "packages", tree / "open", tree):
        assert f"{folder}/other" in str(error.value)
    assert "package_paths" in str(error.value)
    with pytest.raises(FileNotFoundError, match=f"there is no file {tree}/packages/mine/m.stl"):
        files.find("package://mine/m.stl", trusted=True)


def test_xacro_is_told_from_what_it_makes(files):
    made = "<robot><!-- <xacro:include/> --></robot>"
    assert description_text("robot_description", made, files) == (made, None)
    with pytest.raises(RobotError, match="ros2 run xacro xacro"):
        description_text("robot_description", "<robot><xacro:include/></robot>", files)


def test_names_that_no_file_has(files, tree):
    os.mkfifo(tree / "open/pipe.stl")
    for uri in ("", "\0", "x" * 5000, "package://", "open", "pipe.stl", "/dev/zero", "file://"):
        for trusted in (False, True):
            with pytest.raises(FileNotFoundError):
                files.find(uri, trusted=trusted)


def test_a_description_that_is_no_text_is_refused(files, tree):
    (tree / "open/robot.urdf").write_bytes(b"\xff\xfe\x00<robot>")
    for value in ("open/robot.urdf", "open", "none.urdf"):
        with pytest.raises(RobotError, match="robot_description"):
            description_text("robot_description", value, files)
