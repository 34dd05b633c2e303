"""The demonstration as commands to be typed."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from placement_planner_ros.demo.setting import Setting

_ASK = (
    "from placement_planner_ros.client import PlacementClient; "
    "print(PlacementClient().place(deadline=10.0).words)"
)


def by_hand(setting: Setting, arguments: Sequence[str]) -> list[str]:
    """Scene, node and question, each for a terminal of its own; a ROS installation is not needed.

    Args:
        arguments: the node's.
    """
    return [
        f"{_typed_program('placement_scene')} {setting.scene_arguments}",
        f"{_typed_program('placement_planner')} --ros-args {shlex.join(arguments)}",
        f"{_typed_program('python')} -c {shlex.quote(_ASK)}",
    ]


def _typed_program(program: str) -> str:
    """Its name, or its path where a shell would find another of that name, or none."""
    beside = Path(sys.executable).with_name(program)
    found = shutil.which(program)
    if not beside.exists() or (found is not None and Path(found) == beside):
        return program
    near = os.path.relpath(beside)
    return shlex.quote(str(beside) if near.startswith("..") else near)
