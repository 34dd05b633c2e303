"""Release and retreat: the object stands at the published pose, the hand opens and goes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .curve import check_limits, states_along
from .pieces import Piece
from .robot import RobotModel
from .task import Array, Curve, Solution, Task, Tolerances
from .world import World


@dataclass(frozen=True)
class Leaving:
    """What happens after a placement.

    A touch link that opening has brought off the object must not meet it again; the others must
    come off on the first `touching` metres, and not meet it again after that.

    Attributes:
        components: of the object.
        q_start, q_end: (nq,) before the trajectory and after it.
    """

    robot: RobotModel
    task: Task
    components: Sequence[Piece]
    tolerances: Tolerances
    solution: Solution
    q_start: Array
    q_end: Array

    def check(self) -> list[str]:
        """Violations of the release and the retreat; none where there is no retreat."""
        curve = self.solution.retreat
        if curve is None:
            return []
        joints = self.solution.trajectory.joints
        if set(curve.joints) != set(joints):
            return ["retreat: other joints than the trajectory's"]
        opening = self._opening()
        whole = self._world(())
        gaps = whole.object_gaps(opening, self.solution.touch_links)
        states, times = states_along(
            self.robot, curve, opening[-1], self.task.object_vertices, self.tolerances.step
        )
        return [
            *self._check_curve(curve),
            *self._check_release(opening, gaps),
            *self._check_retreat(whole, states, times, gaps),
            *self._check_parted(whole, states[-1]),
        ]

    def _world(self, touching: Sequence[str]) -> World:
        return World.build(
            self.robot,
            self.task,
            self.components,
            self.solution,
            self.tolerances.contact,
            placed=touching,
        )

    def _check_curve(self, curve: Curve) -> list[str]:
        found = []
        end = self.solution.trajectory
        same = [end.joints.index(joint) for joint in curve.joints]
        if not np.array_equal(curve.positions[0], np.asarray(end.positions[-1])[same]):
            found.append("retreat: does not begin where the trajectory ends")
        if max(np.abs(curve.velocities[i]).max() for i in (0, -1)) > 1e-6:
            found.append("retreat: not from rest to rest")
        limits = check_limits(self.robot, curve, self.tolerances)
        return found + [f"retreat: {violation}" for violation in limits]

    def _opening(self) -> Array:
        """(k, nq) states as the hand opens."""
        q_open = self.q_end[None].copy()
        for joint, value in self.solution.gripper_open.items():
            q_open[0, self.robot.index[joint]] = value
        self.robot.fill_mimics(q_open)
        travelled = np.abs(q_open[0] - self.q_end) @ self.robot.reach(self.task.object_vertices)
        count = 2 + int(2 * travelled / self.tolerances.step)
        return np.asarray(self.q_end + np.linspace(0, 1, count)[:, None] * (q_open - self.q_end))

    def _check_release(self, opening: Array, gaps: dict[str, Array]) -> list[str]:
        found = []
        for link, gap in gaps.items():
            deeper = min(gap[0], 0.0) - gap.min()
            if deeper > self.tolerances.pushing:
                found.append(f"release: {link} gets {1000 * deeper:.2f} mm further into the object")
        violations = self._world(self.solution.touch_links).sweep(
            opening, np.zeros(len(opening)), np.inf, set(), self.tolerances
        )
        return found + [f"release: {violation}" for violation in violations]

    def _check_retreat(
        self, whole: World, states: Array, times: Array, gaps: dict[str, Array]
    ) -> list[str]:
        """Stretch by stretch, each with the links that may still touch the object."""
        slides = [link for link, gap in gaps.items() if gap[-1] <= self.tolerances.parted]
        off = self._off(whole, states, slides)
        found, said = [], set()
        for begin, end in pairwise(sorted({0, len(states), *off.values()})):
            world = self._world([link for link in slides if off[link] > begin])
            stretch = slice(begin, end)
            for violation in world.sweep(
                states[stretch], times[stretch], np.inf, set(), self.tolerances
            ):
                who = violation.split(" at ")[0]
                if who not in said:
                    said.add(who)
                    found.append(f"retreat: {violation}")
        return found

    def _off(self, whole: World, states: Array, slides: Sequence[str]) -> dict[str, int]:
        """Of links that touch the object at first the row of the state from which on none may."""
        if not slides:
            return {}
        frame = self.solution.tip_frame
        tips = np.array([self.robot.frame_pose(q, frame)[:3, 3] for q in states])
        gone = np.linalg.norm(tips - tips[0], axis=1) > self.tolerances.touching
        last = int(np.argmax(gone)) if gone.any() else len(states)
        gaps = whole.object_gaps(states[:last], slides)
        off = {}
        for link in slides:
            parted = gaps[link] > self.tolerances.parted
            off[link] = int(np.argmax(parted)) if parted.any() else last
        return off

    def _check_parted(self, whole: World, q_last: Array) -> list[str]:
        gaps = whole.object_gaps(np.vstack([self.q_start, q_last]))
        return [
            f"retreat: ends with {link} {1000 * end:.2f} mm from the object"
            for link, (start, end) in gaps.items()
            if end < self.tolerances.parted and start != end  # what the arm does not move stays
        ]
