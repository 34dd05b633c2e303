"""The largest tilt of every solution of `python -m benchmarks cases --carry`, computed anew.

python test/by_hand verify_carry results/cases

Prints, for each limit, how many solutions there are and by how much the object leans at most.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from checker import RobotModel, way_of_object

from benchmarks.carry.runs import RUNS_FILE, SOLUTIONS, solution_file
from benchmarks.json_lines import read_lines
from placement_planner_ros.scenes.yumi import load_yumi
from placement_planner_ros.share import PACKAGE, share_path


def main(folder: Path) -> int:
    """1 where one leans by more than its limit, or has not been written."""
    urdf = share_path("urdf", "yumi.urdf")
    robot = RobotModel.read(
        urdf.read_text(encoding="utf-8"),
        share_path("urdf", "yumi.srdf").read_text(encoding="utf-8"),
        {PACKAGE: urdf.parent.parent},
    )
    names = load_yumi().joint_names
    leant = defaultdict(list)
    for entry in read_lines(folder / RUNS_FILE):
        if entry["failure"] or not entry["limited"]["found"]:
            continue
        saved = np.load(solution_file(folder / SOLUTIONS, entry))
        tilt = tilt_of(robot, names, saved)
        leant[entry["degrees"], entry["opposite"]].append(tilt)
    for (degrees, opposite), tilts in sorted(leant.items()):
        kind = "opposite" if opposite else "near"
        print(f"{degrees:g}°, {kind}: {len(tilts)} solutions, at most {max(tilts):.4f}°")
    return int(any(max(tilts) > degrees for (degrees, _), tilts in leant.items()))


def tilt_of(robot, names, saved) -> float:
    """The largest of one solution, degrees."""
    q = robot.configuration(dict(zip(names, saved["q_start"].tolist(), strict=True)))
    curve = SimpleNamespace(
        joints=tuple(saved["joints"].tolist()),
        times=saved["times"],
        positions=saved["positions"],
        velocities=saved["velocities"],
        accelerations=saved["accelerations"],
    )
    solution = SimpleNamespace(
        trajectory=curve,
        tip_frame=str(saved["tip_frame"]),
        T_tip_object=saved["T_tip_object"],
    )
    task = SimpleNamespace(up=saved["up"], center_of_mass=np.zeros(3))
    return float(np.degrees(way_of_object(robot, task, solution, q).tilt))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
