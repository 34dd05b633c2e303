"""Files named by users."""

import pytest

from placement_planner_ros.ros.inputs.resources import package_dirs, package_share, resolve
from placement_planner_ros.share import PACKAGE

URDF = '<robot name="r"><link name="a"><collision><geometry><mesh filename="package://none/m.stl"/></geometry></collision></link></robot>'


@pytest.mark.parametrize("index", ["", "/nowhere"])
def test_a_package_is_unknown_with_and_without_an_index(monkeypatch, index):
    monkeypatch.setenv("AMENT_PREFIX_PATH", index)
    assert package_dirs(URDF) == {}
    with pytest.raises(FileNotFoundError, match="none"):
        resolve("package://none/m.stl")
    assert (package_share(PACKAGE) / "urdf").is_dir()
