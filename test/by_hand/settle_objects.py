"""Hold the rests that objects are given against a physics engine, and write what differs.

python test/by_hand settle_objects --output results/objects
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from helpers.drops import Drops, Mass, mass_of
from helpers.scans import SHAPES, finer, noisy
from helpers.shared import SHARED

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.scenes.objects import OBJECT_NAMES, object_by_name

NOISE = 0.001
"""Standard deviation of a scan's vertices along their normals, metres."""
SCAN_TRIANGLES = (5_000, 20_000, 50_000, 100_000, 200_000)
"""Of the scans of the shapes, one after the other."""
HELD = ("bowl", "plate", "plastic_glass", "milk", "cereal")
"""Files of the shared data."""

HEIGHT = 0.001
"""Metres from which rests are tried."""
PUSH = 0.063
"""m/s that a rest is pushed with: 2 mJ/kg."""
NEAR, TURNED, MOVED = np.radians(15.0), np.radians(5.0), 0.005
"""Rests within the first are one; one holds where the body turns and moves by less than those."""
_ROLLED = np.radians(20.0)


@dataclass(frozen=True)
class Thing:
    """A mesh, and its centre of mass where that is given."""

    mesh: trimesh.Trimesh
    center: np.ndarray | None = None


def objects() -> dict[str, Thing]:
    """All objects by name."""
    made: dict[str, Thing] = {}
    for name, make in SHAPES.items():
        center = object_by_name(name).center_of_mass if name in OBJECT_NAMES else None
        made[name] = Thing(make(), center)
    for name in HELD:
        path = SHARED / "data" / "objects" / f"{name}.stl"
        if path.exists():
            made[name] = Thing(trimesh.load(path))
    return made


def things() -> dict[str, Thing]:
    """All objects and scans by name."""
    made = objects()
    for number, (name, triangles) in enumerate(zip(SHAPES, itertools.cycle(SCAN_TRIANGLES))):
        mesh = noisy(finer(made[name].mesh, triangles), NOISE, np.random.default_rng(number))
        made[f"scan of {name}"] = Thing(mesh, made[name].center)
    return made


def compared(thing: Thing, falls: int, yaws: int, rng: np.random.Generator) -> dict:
    """What the planner offers, what physics finds, and where they differ.

    Args:
        falls: from random orientations, whose ends are the rests that there are.
        yaws: draws with which each rest is tried.
    """
    began = time.process_time()
    body = Body.from_mesh(
        thing.mesh.vertices,
        thing.mesh.faces,
        thing.center,
        settings=BodySettings(allow_rolling=True),
    )
    seconds = time.process_time() - began
    mass = mass_of(thing.mesh)
    if thing.center is not None:
        mass = Mass(mass.volume, thing.center, mass.inertia)
    drops = Drops(np.asarray(thing.mesh.vertices), mass)
    offered = [_tried(drops, face.normal, yaws, rng) for face in body.faces if not face.rolls]
    rolling = [face.normal for face in body.faces if face.rolls]
    ends = [drops.drop(_random(rng), 0.0, 0.005, seconds=8.0) for _ in range(falls)]
    found = []
    for down, count in _clusters([end.down for end in ends if end.still]):
        rest = _tried(drops, down, yaws, rng) | {"share": count / falls}
        firm = [o for o in offered if _angle(np.array(o["down"]), down) < NEAR]
        level = [abs(drops.height(n) - drops.height(down)) for n in rolling]
        round_ = min(level, default=np.inf) < max(0.0015, 0.04 * drops.height(down))
        rest["found"] = "firm" if firm else "rolling" if round_ else ""
        found.append(rest)
    return {
        "triangles": len(thing.mesh.faces),
        "seconds": seconds,
        "center_apart": float(np.linalg.norm(body.center_of_mass - mass.center)),
        "offered": offered,
        "rolling": len(rolling),
        "settled": found,
        "unsettled": int(sum(not end.still for end in ends)),
    }


def _tried(drops: Drops, down: np.ndarray, yaws: int, rng: np.random.Generator) -> dict:
    ends = [drops.drop(down, yaw, HEIGHT) for yaw in rng.uniform(0.0, 2.0 * np.pi, yaws)]
    turned = [_angle(end.down, down) for end in ends]
    held = [t < TURNED and end.moved < MOVED for t, end in zip(turned, ends, strict=True)]
    pushed = [drops.drop(down, yaw, 0.0, push=PUSH) for yaw in np.linspace(0.0, 5.5, 8)]
    return {
        "down": np.round(down, 4).tolist(),
        "held": int(sum(held)),
        "tries": yaws,
        "turned": float(np.degrees(max(turned))),
        "moved": max(end.moved for end in ends),
        "firm": bool(all(_angle(end.down, down) < _ROLLED for end in pushed)),
    }


def _clusters(downs: list[np.ndarray]) -> list[tuple[np.ndarray, int]]:
    """Directions that are none of them near another, and how many are near each."""
    left = np.array(downs).reshape(-1, 3)
    made = []
    while len(left):
        near = left @ left.T > np.cos(NEAR)
        best = int(near.sum(axis=1).argmax())
        made.append((left[best], int(near[best].sum())))
        left = left[~near[best]]
    return made


def _random(rng: np.random.Generator) -> np.ndarray:
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction)


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(2.0 * np.arcsin(min(0.5 * np.linalg.norm(a - b), 1.0)))


def summary(rows: dict[str, dict]) -> dict[str, float]:
    """Of all objects: rests that hold, those of them found, those offered, and what gave way."""
    both = [r for row in rows.values() for r in row["settled"] if _holds(r) and r["firm"]]
    holds = [r for row in rows.values() for r in row["settled"] if _holds(r)]
    offered = [r for row in rows.values() for r in row["offered"]]
    return {
        "rests that hold": len(holds),
        "of these found": sum(bool(r["found"]) for r in holds),
        "of these, only to roll": sum(r["found"] == "rolling" for r in holds),
        "rests that hold, and under a push": len(both),
        "of those found": sum(bool(r["found"]) for r in both),
        "rests offered": len(offered),
        "of these that do not hold": sum(r["held"] < r["tries"] for r in offered),
        "drops of these": sum(r["tries"] for r in offered),
        "drops that did not stay": sum(r["tries"] - r["held"] for r in offered),
        "rests offered that a push tips": sum(not r["firm"] for r in offered),
    }


def _holds(rest: dict) -> bool:
    return rest["held"] == rest["tries"]


def main() -> None:
    """Compare what the folder does not hold yet; print a line for each object and what differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("results/objects"))
    parser.add_argument("--only", nargs="+", metavar="NAME")
    parser.add_argument("--falls", type=int, default=200)
    parser.add_argument("--yaws", type=int, default=100)
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    file = options.output / "rests.json"
    rows = json.loads(file.read_text()) if file.exists() else {}
    for name, thing in things().items():
        if name in rows or (options.only and name not in options.only):
            continue
        row = compared(thing, options.falls, options.yaws, np.random.default_rng(0))
        rows[name] = row
        file.write_text(json.dumps(rows, indent=1))
        print(name, f"{row['triangles']} triangles, {row['seconds']:.2f} s,", flush=True)
        for rest in row["offered"]:
            if not _holds(rest) or not rest["firm"]:
                print("   offered, gives way:", rest, flush=True)
        for rest in row["settled"]:
            if _holds(rest) and not rest["found"]:
                print("   holds, not found:", rest, flush=True)
    for what, number in summary(rows).items():
        print(f"{what}: {number}")


if __name__ == "__main__":
    main()
