"""`python -m benchmarks`: the paper's cases and evaluation, robots, situations, clouds, speeds."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from benchmarks.evaluation.command import add_evaluation_commands
from benchmarks.real_clouds.command import add_clouds_command
from benchmarks.robots.command import add_robots_command
from benchmarks.situations.command import add_situations_command
from benchmarks.speed.command import add_speed_command
from benchmarks.worlds.command import add_worlds_command
from placement_planner_ros.core.errors import PlacementPlannerError


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    add_evaluation_commands(commands)
    add_speed_command(commands)
    add_robots_command(commands)
    add_situations_command(commands)
    add_clouds_command(commands)
    add_worlds_command(commands)
    parsed = parser.parse_args(arguments)
    try:
        return int(parsed.command_function(parsed))
    except PlacementPlannerError as error:
        print(f"python -m benchmarks: {error}", file=sys.stderr)
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith(("matplotlib", "PIL")):
            raise
        remedy = "whatever was measured is recorded: run pip install '.[benchmarks]'"
        print(f"python -m benchmarks: figures need {error.name}; {remedy}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
