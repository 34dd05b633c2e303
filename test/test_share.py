"""Shipped files are found in a checkout and under an install prefix alike."""

import importlib.util
import shutil
from pathlib import Path

import pytest

from placement_planner_ros import share


def load_from(folder: Path):
    folder.mkdir(parents=True)
    copy = Path(shutil.copy(share.__file__, folder))
    spec = importlib.util.spec_from_file_location("share_copy", copy)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("packages", ["lib/python3.12/site-packages", "lib/python3/dist-packages"])
def test_prefix(tmp_path, packages):
    module = load_from(tmp_path / packages / share.PACKAGE)
    config = tmp_path / "share" / share.PACKAGE / "config" / "yumi.yaml"
    config.parent.mkdir(parents=True)
    config.touch()
    assert module.share_path("config", "yumi.yaml") == config


def test_ament_prefix(tmp_path, monkeypatch):
    module = load_from(tmp_path / "elsewhere" / share.PACKAGE)
    folder = tmp_path / "prefix" / "share" / share.PACKAGE / "urdf"
    folder.mkdir(parents=True)
    with pytest.raises(FileNotFoundError, match="urdf of placement_planner_ros"):
        module.share_path("urdf")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path / 'prefix'}")
    assert module.share_path("urdf") == folder
