"""docs/parameters.md, made of the table of parameters.

Run `python -m placement_planner_ros.ros.parameters.page docs/parameters.md` after a change of it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from placement_planner_ros.core.settings import FINITE
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

Made from the node's own table by `python -m placement_planner_ros.ros.parameters.page`; a test
compares. The running node says the same: `ros2 param describe /placement_planner NAME`.

Integers are accepted for doubles. A bad value is refused with its reason when it is set, an unknown
name with the nearest known one; at start-up such names are told in the log. What is set takes
effect at the next start; parameters given to `~/start_with` count for that run only.
`ros2 param load` and `--params-file` take what `ros2 param dump` wrote: start-up parameters may be
set to the value they have, and a description that was given as text is kept on one line, without
comments.

The defaults of `<arm>` are those of the bundled YuMi's left arm; they are empty where
`robot_description` is set.
"""
_TITLES = {
    "": "What a run does, and among what",
    "arm": "The arms",
    "object": "The object",
    "start-up": "Read at start-up only",
}
_OPEN_CHOICES = ("objective",)
"""Parameters whose choices depend on what is installed; their words say what they may be."""


def page() -> str:
    """The page as Markdown."""
    arms = list(TIP_FRAMES)
    specs = [*fixed_specs(), arms_spec(arms), sensor_pose_spec("<frame>")]
    groups: dict[str, list[Spec]] = {title: [] for title in _TITLES}
    for spec in specs:
        groups[_group(spec)].append(spec)
    groups["arm"] += arm_specs(arms[0], yumi=True)
    parts = [_HEAD]
    for group, title in _TITLES.items():
        rows = [_row(spec, spec.name.replace(f"{arms[0]}.", "<arm>.")) for spec in groups[group]]
        head = "| parameter | type | default | may be | meaning |\n|---|---|---|---|---|"
        parts.append("\n".join([f"## {title}\n", head, *rows, ""]))
    return "\n".join(parts)


def _group(spec: Spec) -> str:
    if spec.startup:
        return "start-up"
    if spec.name == "arms":
        return "arm"
    return "object" if spec.name.startswith("object.") else ""


def _row(spec: Spec, name: str) -> str:
    meaning = spec.meaning
    unit = f" ({meaning.unit})" if meaning.unit else ""
    words = f"{meaning.text.rstrip('.')}{unit}."
    return f"| `{name}` | {spec.kind} | {_shown(spec.default)} | {_allowed(spec)} | {words} |"


def _shown(value: Value) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_shown(each) for each in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value) or "(empty)"


def _allowed(spec: Spec) -> str:
    meaning = spec.meaning
    if meaning.choices and spec.name not in _OPEN_CHOICES:
        return ", ".join(meaning.choices)
    length = f"{spec.length} values " if spec.length >= 0 else ""
    interval = "" if meaning.interval == FINITE else meaning.interval
    return f"{length}{interval}".strip()


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the page to the file that is named."""
    (file,) = sys.argv[1:] if arguments is None else arguments
    Path(file).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
