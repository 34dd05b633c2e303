"""Release every recorded placement of `python -m benchmarks cases` in a physics engine.

python test/by_hand settle_cases results/cases --friction 0.3 0.8
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
from helpers.settle import Settled, settle_placed

from benchmarks.cases import case_scene
from benchmarks.household import object_by_name

MOVED, TILTED = 0.005, np.deg2rad(2.0)
FRICTIONS = (0.3, 0.8)
"""Sliding friction of all contacts: smooth plastic on lacquer, rubber on wood."""


def stays(path: Path, friction: float) -> tuple[str, Settled]:
    """The object of a recorded placement, and how far it comes."""
    with np.load(path) as data:
        case, T_world_object = json.loads(str(data["case"])), pin.SE3(data["T_world_object"])
    held = object_by_name(case["object"])
    solids = case_scene(case["scene"]).parts
    result = settle_placed(solids, held, T_world_object, friction=friction)
    return case["object"], result


def did_stay(one: Settled) -> bool:
    """Within 5 mm and 2°."""
    return one.moved < MOVED and one.tilted < TILTED


def main() -> int:
    """Name those that do not stay, and tell the share that does."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--share", type=float, default=0.99, help="must stay (default 0.99)")
    parser.add_argument(
        "--friction", type=float, nargs="+", default=FRICTIONS, help="of all contacts, in turn"
    )
    arguments = parser.parse_args()
    paths = sorted((arguments.folder / "solutions").glob("*.npz"))
    if not paths:
        parser.error(f"no solutions in {arguments.folder}")
    stayed = total = 0
    for path, friction in itertools.product(paths, arguments.friction):
        name, result = stays(path, friction)
        total, stayed = total + 1, stayed + did_stay(result)
        if not did_stay(result):
            print(
                f"{path.name}: {name}, friction {friction:g}, moved {1000 * result.moved:.1f} mm,"
                f" tilted {np.rad2deg(result.tilted):.1f}°",
                flush=True,
            )
    print(f"{stayed} of {total} stayed")
    return 0 if stayed >= arguments.share * total else 1


if __name__ == "__main__":
    sys.exit(main())
