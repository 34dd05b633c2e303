"""docs/parameters.md, made of the table of parameters.

Run `python docs/parameters_page.py docs/parameters.md` after a change of it.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from placement_planner_ros.core.settings import FINITE
from placement_planner_ros.ros.node_words import in_node_words
from placement_planner_ros.ros.parameters.spec import Spec, Value
from placement_planner_ros.ros.parameters.table import (
    arm_specs,
    arms_spec,
    fixed_specs,
    sensor_pose_spec,
)
from placement_planner_ros.scenes.yumi import TIP_FRAMES

_HEAD = """\
# Parameters

Made from the node's own table by `python docs/parameters_page.py`; a test
compares. The running node says the same: `ros2 param describe /placement_planner NAME`.

Integers are accepted for doubles. A bad value is refused with its reason when it is set; of an
unknown name `~/start_with`, and at start-up the log, tell the nearest known one. What is set takes
effect at the next start; parameters given to `~/start_with` count for that run only. What is read
at start-up may be set to the value it has. `--params-file` takes what `ros2 param dump` wrote.

The defaults of `<arm>` are those of the bundled YuMi's left arm; they are empty where
`robot_description` is set.
"""
_TABLE = "| parameter | type | default | may be | meaning |\n|---|---|---|---|---|"
_OPEN_CHOICES = ("objective",)
"""Parameters whose choices depend on what is installed; their words say what they may be."""


def parameter_page() -> str:
    """The page as Markdown."""
    arms = list(TIP_FRAMES)
    specs = [*fixed_specs(), sensor_pose_spec("<frame>")]
    later = [spec for spec in specs if not spec.startup]
    of_arm = [
        replace(spec, name=spec.name.replace(arms[0], "<arm>"))
        for spec in arm_specs(arms[0], yumi=True)
    ]
    groups = {
        "What a run does, and among what": [s for s in later if not s.name.startswith("object.")],
        "The arms": [arms_spec(arms), *of_arm],
        "The object": [s for s in later if s.name.startswith("object.")],
        "Read at start-up only": [s for s in specs if s.startup],
    }
    parts = [
        "\n".join([f"## {title}\n", _TABLE, *map(_table_row, rows), ""])
        for title, rows in groups.items()
    ]
    return "\n".join([_HEAD, *parts])


def _table_row(spec: Spec) -> str:
    meaning = spec.meaning
    unit = f" ({meaning.unit})" if meaning.unit else ""
    allowed = "" if meaning.interval == FINITE else meaning.interval
    if meaning.choices and spec.name not in _OPEN_CHOICES:
        allowed = ", ".join(meaning.choices)
    words = f"{in_node_words(meaning.text).rstrip('.')}{unit}."
    return f"| `{spec.name}` | {spec.kind} | {_shown_value(spec.default)} | {allowed} | {words} |"


def _shown_value(value: Value) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_shown_value, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value) or "(empty)"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(parameter_page(), encoding="utf-8")
