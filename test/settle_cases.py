"""Release every recorded placement of `placement_benchmark cases` in a physics engine.

python test/settle_cases.py results/cases
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
from settle import settle

from placement_planner_ros.scenes.objects import object_by_name
from placement_planner_ros.scenes.scenes import scene_by_name

MOVED, TILTED = 0.005, np.deg2rad(2.0)


def main() -> int:
    """Name those that do not stay, and tell the share that does."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--share", type=float, default=0.99, help="must stay (default 0.99)")
    arguments = parser.parse_args()
    paths = sorted((arguments.folder / "solutions").glob("*.npz"))
    if not paths:
        parser.error(f"no solutions in {arguments.folder}")
    stayed, most_moved, most_tilted = 0, 0.0, 0.0
    for path in paths:
        with np.load(path) as data:
            case, T_world_object = json.loads(str(data["case"])), pin.SE3(data["T_world_object"])
        held = object_by_name(case["object"])
        result = settle(
            [part.vertices for part in scene_by_name(case["scene"]).parts],
            [part.vertices for part in held.parts],
            held.center_of_mass,
            T_world_object,
        )
        if result.moved < MOVED and result.tilted < TILTED:
            stayed += 1
            most_moved = max(most_moved, result.moved)
            most_tilted = max(most_tilted, result.tilted)
        else:
            print(
                f"{path.name}: moved {1000 * result.moved:.1f} mm,"
                f" tilted {np.rad2deg(result.tilted):.1f}°"
            )
    print(
        f"{stayed} of {len(paths)} stayed; those moved up to {1000 * most_moved:.2f} mm"
        f" and tilted up to {np.rad2deg(most_tilted):.2f}°"
    )
    return 0 if stayed >= arguments.share * len(paths) else 1


if __name__ == "__main__":
    sys.exit(main())
