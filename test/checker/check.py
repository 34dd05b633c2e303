"""All checks of a solution."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from .asked import check_asked
from .carrying import check_carrying
from .clearance import Clearance
from .curve import check_curve, check_limits, states_along
from .leaning import check_leaning, touched
from .leaving import Leaving
from .pieces import object_pieces
from .robot import RobotModel
from .stance import check_stance, standing_along
from .task import Array, Solution, Task, Tolerances, world_vertices
from .world import World


class SolutionChecker:
    """Checks any number of solutions to one task."""

    def __init__(self, task: Task, tolerances: Tolerances | None = None) -> None:
        self.task = task
        self.tolerances = Tolerances() if tolerances is None else tolerances
        self.robot = RobotModel.read(task.urdf, task.srdf, task.package_dirs)
        self.components = object_pieces(task.object_vertices, task.object_triangles)
        self._clearance = Clearance(task, self.components, self.tolerances)

    def check(self, solution: Solution, previous_objective: float | None = None) -> list[str]:
        """Violations of one solution."""
        shape = self._check_shape(solution)
        if shape:
            return shape
        task, tolerances, q_start = self.task, self.tolerances, self._q_start()
        states, times = states_along(
            self.robot, solution.trajectory, q_start, task.object_vertices, tolerances.step
        )
        return [
            *self._check_start(solution),
            *check_limits(self.robot, solution.trajectory, tolerances),
            *check_carrying(self.robot, task, solution, q_start, tolerances),
            *self._check_end(solution, states[-1]),
            *self._check_collisions(solution, states, times),
            *self._check_rest(np.asarray(solution.placement_pose)),
            *self._check_objective(solution, previous_objective),
            *check_asked(
                task,
                np.asarray(solution.placement_pose),
                solution.objective,
                self.clearance_bounds,
                tolerances,
            ),
            *Leaving(
                self.robot, task, self.components, tolerances, solution, q_start, states[-1]
            ).check(),
        ]

    def clearance(self, T_world_object: Array) -> float:
        """C: mean distance of the object's voxel centres sideways and upwards, metres."""
        return self._clearance.mean(T_world_object)

    def clearance_bounds(self, T_world_object: Array) -> tuple[float, float]:
        """Least and greatest C where heights are known to a layer of cells only."""
        return self._clearance.bounds(T_world_object)

    def _q_start(self) -> Array:
        return self.robot.configuration(self.task.q_start)

    def _check_shape(self, solution: Solution) -> list[str]:
        found = check_curve(self.robot, solution.trajectory, "trajectory")
        if not found and not 0 <= solution.approach_start <= solution.trajectory.times[-1]:
            found.append("approach_start: outside the trajectory")
        if solution.retreat is not None:
            found += check_curve(self.robot, solution.retreat, "retreat")
        return found

    def _check_start(self, solution: Solution) -> list[str]:
        curve = solution.trajectory
        q0 = self._q_start()[[self.robot.index[name] for name in curve.joints]]
        error = np.abs(curve.positions[0] - q0).max()
        found = [f"start: {error:.2g} from q_0"] if error > 1e-6 else []
        if np.abs(curve.velocities[0]).max() > 1e-6:
            found.append("start: moving")
        return found

    def _check_end(self, solution: Solution, q_end: Array) -> list[str]:
        found = []
        if np.abs(solution.trajectory.velocities[-1]).max() > 1e-6:
            found.append("end: not at rest")
        T = self.robot.frame_pose(q_end, solution.tip_frame) @ solution.T_tip_object
        published = np.asarray(solution.placement_pose)
        offset = float(np.linalg.norm(T[:3, 3] - published[:3, 3]))
        angle = float(np.linalg.norm(pin.log3(T[:3, :3].T @ published[:3, :3])))
        if offset > self.tolerances.position:
            found.append(f"end: object {1000 * offset:.2f} mm from the published pose")
        if angle > self.tolerances.angle:
            found.append(f"end: object turned by {np.rad2deg(angle):.2f}° from the published pose")
        return found

    def _check_rest(self, T: Array) -> list[str]:
        """What is wrong with an object left standing, or where it may, leaning."""
        found = check_stance(self.task, T, self.tolerances)
        if found and self.task.friction is not None:
            leans = check_leaning(self.task, T, self.tolerances)
            return leans + [fault for fault in found if fault.startswith("volume")]
        return found

    def _check_collisions(self, solution: Solution, states: Array, times: Array) -> list[str]:
        pose = np.asarray(solution.placement_pose)
        normal = standing_along(self.task, pose, self.tolerances)
        lowest = float((world_vertices(self.task, pose) @ normal).min())
        support = {
            solid.name
            for solid in self.task.solids
            if abs(float((solid.vertices @ normal).max()) - lowest)
            <= self.tolerances.contact + 1e-9
        }
        if self.task.friction is not None:
            support |= touched(self.task, pose, self.tolerances)[2]
        world = World.build(
            self.robot, self.task, self.components, solution, self.tolerances.contact
        )
        return world.sweep(states, times, solution.approach_start, support, self.tolerances)

    def _check_objective(self, solution: Solution, previous: float | None) -> list[str]:
        found = []
        sign = {"maximize_clearance": 1.0, "minimize_clearance": -1.0}.get(self.task.objective)
        if sign is not None:
            bounds = self.clearance_bounds(np.asarray(solution.placement_pose))
            own, slack = sign * solution.objective, self.tolerances.objective
            if not bounds[0] - slack <= own <= bounds[1] + slack:
                low, high = sorted(sign * bound for bound in bounds)
                found.append(
                    f"objective: published {solution.objective:.4f}, is {low:.4f} to {high:.4f}"
                )
        if previous is not None and solution.objective <= previous:
            found.append(f"objective: {solution.objective:.6g} after {previous:.6g}")
        return found
