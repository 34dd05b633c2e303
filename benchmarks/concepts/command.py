"""`python -m benchmarks concepts`: the figures of docs/concepts.md."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.jobs import say


def add_concepts_command(commands: Any) -> None:
    """Add `concepts`, which sets `command_function`.

    Args:
        commands: what `ArgumentParser.add_subparsers` returned.
    """
    concepts = commands.add_parser("concepts", help="draw how the search works")
    concepts.add_argument("--cloud", type=Path, help="a PCD file of a table, to draw its regions")
    concepts.add_argument("--output", type=Path, default=Path("docs/images"))
    concepts.set_defaults(command_function=draw_concepts)


def draw_concepts(arguments: argparse.Namespace) -> int:
    """Draw them.

    Raises:
        ParameterError: the cloud cannot be read, or shows no table.
    """
    from benchmarks.concepts.division import draw_division
    from benchmarks.concepts.edge import draw_edge
    from benchmarks.concepts.regions import draw_regions
    from benchmarks.real_clouds.pcd_file import read_pcd
    from benchmarks.real_clouds.table import on_table

    output = arguments.output
    output.mkdir(parents=True, exist_ok=True)
    if arguments.cloud is not None:
        cloud = on_table(read_pcd(arguments.cloud), np.random.default_rng(0))
        draw_regions(output / "concept_regions.png", cloud, arguments.cloud.name)
    draw_division(output / "concept_search.png")
    draw_edge(output / "concept_edge.png")
    say(f"wrote {output}")
    return 0
