"""How often the planner's answers about an arm agree with its original triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from benchmarks.robots.triangles import Boxes, TriangleRobot
from placement_planner_ros.core.collision.arm import ArmCollision, CollisionSettings
from placement_planner_ros.core.robot.arm import Arm, MovingArm
from placement_planner_ros.core.scene.grid import GridSettings, ObstacleSet
from placement_planner_ros.core.types import Array

TOLERANCE = 0.002
"""m beyond the margin from which on an answer has to be `free`: `mesh_tolerance`."""
NEAR = 0.010
"""m from contact, within which half of the configurations are."""
_TIES = 1e-5
"""m by which the judge's own distances may be off."""
_REACH = 1.5
"""m, no point of an arm moves further for one radian."""
_BLOCK = 2000
"""Configurations drawn at a time."""
_HALVINGS = 14
"""Of a way from a free configuration to a colliding one."""
_SHOWN = 10
"""Wrong answers that are kept in words."""
_TRIES = 2000
"""Places looked at, of boxes around an arm."""
_AWAY = 0.25
"""m of boxes from the inner half of an arm."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotFiles:
    """What the judge reads: the URDF's text, and folders that hold the packages it names."""

    urdf: str
    package_dirs: Sequence[str | Path] = ()


@dataclass(frozen=True, slots=True)
class TriangleAgreement:
    """Answers about configurations, by the judge.

    Attributes:
        configurations: asked about.
        called_free: of these, by the planner.
        wrongly_free: of these, nearer than the margin, or with links that meet.
        clear: farther than margin and tolerance from everything, links from each other by the
            tolerance.
        clear_called_free: of these, by the planner.
        wrong: of what was wrongly called free the first, in words.
    """

    configurations: int
    called_free: int
    wrongly_free: int
    clear: int
    clear_called_free: int
    wrong: tuple[str, ...] = ()

    @property
    def share(self) -> float:
        """Of what is clear, called free; 1 where nothing is clear."""
        return self.clear_called_free / self.clear if self.clear else 1.0


def judge_of(moving: MovingArm, files: RobotFiles) -> TriangleRobot:
    """The robot's triangles, with the pairs of links that the planner keeps apart."""
    robot = moving.robot
    links = robot.geometry_links
    pairs = {
        frozenset({links[pair.first], links[pair.second]}) for pair in robot.geometry.collisionPairs
    }
    return TriangleRobot(files.urdf, files.package_dirs, moving.arm.joints, pairs)


def compare_answers(
    moving: MovingArm,
    files: RobotFiles,
    obstacles: ObstacleSet,
    count: int,
    rng: np.random.Generator,
) -> TriangleAgreement:
    """Ask the planner and the judge about configurations, half of them within `NEAR` of contact.

    Args:
        count: how many.
    """
    collision, judge = ArmCollision(moving, None, obstacles), judge_of(moving, files)
    margin = CollisionSettings().collision_margin
    boxes = Boxes(obstacles.lower, obstacles.upper)
    asked = called_free = wrongly_free = clear = clear_called_free = 0
    wrong: list[str] = []
    for begin in range(0, count, _BLOCK):
        half = -(-min(_BLOCK, count - begin) // 2)
        Q = np.vstack(drawn_configurations(collision, moving.arm, half, NEAR, rng))
        for q, free in zip(Q, collision.free_batch(Q), strict=True):
            judge.place(_joint_positions(moving, q))
            asked, called_free = asked + 1, called_free + bool(free)
            # What is clear keeps the margin, too: asked first, as it spares the second question.
            if not (
                judge.near_itself(TOLERANCE + _TIES)
                or judge.near_boxes(boxes, margin + TOLERANCE + _TIES)
            ):
                clear += 1
                clear_called_free += bool(free)
            elif free:
                met = judge.near_itself(0.0) or judge.near_boxes(boxes, margin - _TIES)
                if met:
                    wrongly_free += 1
                    wrong += [f"{met} at {q.tolist()}"] if len(wrong) < _SHOWN else []
    counts = called_free, wrongly_free, clear, clear_called_free
    return TriangleAgreement(asked, *counts, tuple(wrong))


def clutter_around(moving: MovingArm, number: int, rng: np.random.Generator) -> ObstacleSet:
    """Boxes of 1 to 8 cm where the outer half of the arm comes to be, away from its inner half."""
    robot, arm = moving.robot, moving.arm
    data = robot.model.createData()
    tip = robot.frame_id(arm.tip_frame)
    ids = [robot.model.getJointId(name) for name in arm.joints]
    inner, outer = ids[: len(ids) // 2], ids[len(ids) // 2 :]
    points: list[Array] = []
    for _ in range(_TRIES):
        if len(points) == number:
            break
        q = np.array(moving.q_rest)
        q[arm.q_index] = rng.uniform(arm.lower, arm.upper)
        pin.framesForwardKinematics(robot.model, data, q)
        places = [data.oMi[i].translation for i in outer] + [data.oMf[tip].translation]
        at = places[rng.integers(len(places))] + rng.normal(0.0, 0.05, 3)
        if min(np.linalg.norm(at - data.oMi[i].translation) for i in inner) < _AWAY:
            continue
        size = rng.uniform(0.01, 0.08, 3)
        points.append(at + (rng.random((200, 3)) - 0.5) * size)
    cloud = np.vstack(points)
    bounds = cloud.min(axis=0) - 0.1, cloud.max(axis=0) + 0.1
    return ObstacleSet.from_points(cloud, GridSettings(cell_size=0.02), bounds)


def _joint_positions(moving: MovingArm, q: Array) -> dict[str, float]:
    robot, whole = moving.robot, np.array(moving.q_rest, dtype=np.float64)
    whole[moving.arm.q_index] = q
    names = zip(robot.joint_names, whole.tolist(), strict=True)
    return {name: value for name, value in names if name not in robot.mimics}


def drawn_configurations(
    collision: ArmCollision, arm: Arm, count: int, near: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """(count, dof) each: where the answer changes, within so many metres, and anywhere."""
    anywhere = rng.uniform(arm.lower, arm.upper, (count, arm.dof))
    free = collision.free_batch(anywhere)
    begins, ends = anywhere[free], anywhere[~free]
    if len(begins) == 0 or len(ends) == 0:
        return anywhere, anywhere
    a = begins[rng.integers(len(begins), size=count)]
    b = ends[rng.integers(len(ends), size=count)]
    for _ in range(_HALVINGS):
        middle = (a + b) / 2.0
        still = collision.free_batch(middle)[:, None]
        a, b = np.where(still, middle, a), np.where(still, b, middle)
    way = rng.normal(size=a.shape)
    way *= near * rng.random((count, 1)) / (_REACH * np.abs(way).sum(axis=1, keepdims=True))
    return np.clip(a + way, arm.lower, arm.upper), anywhere
