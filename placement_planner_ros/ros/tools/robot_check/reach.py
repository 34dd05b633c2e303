"""How much of the target volume the arms reach, and whether a planner can be made of it all."""

from __future__ import annotations

import math
import time

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.grasp.free_yaw_ik import FreeYawIK
from placement_planner_ros.core.planner import PlacementPlanner
from placement_planner_ros.core.reach.ik import IKSettings, InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.reach.turntable import POSE_DIMENSIONS, lacks_directions
from placement_planner_ros.core.reach.upright_motion import most_upright
from placement_planner_ros.core.robot.model import Arm
from placement_planner_ros.core.stopping import StoppedError, stoppable
from placement_planner_ros.core.types import Array, TargetVolume
from placement_planner_ros.ros.inputs.cloud_store import PointSet
from placement_planner_ros.ros.run.preparation import make_planner
from placement_planner_ros.ros.run.snapshot import Snapshot
from placement_planner_ros.ros.run.surroundings import Surroundings
from placement_planner_ros.ros.run.worker import PREPARATION_LIMIT_S
from placement_planner_ros.ros.tools.robot_check.findings import Findings
from placement_planner_ros.ros.tools.robot_check.subject import Subject

POSES = 200
"""Random poses in V per arm and grasp."""


def check_reach(subject: Subject, findings: Findings) -> None:
    """Say for which share of random poses in V there is inverse kinematics."""
    arms = [arm for arm in subject.arms if arm.grasps]
    if not arms or subject.body is None:
        return
    findings.title("random poses of the object in target_volume that an arm reaches")
    most = 0.0
    for arm in arms:
        for grasp in range(len(arm.grasps)):
            share = reached_share(subject, arm, grasp, subject.parameters.volume)
            most = max(most, share)
            findings.say(f"{arm.name}, grasp {grasp}: {share:.0%}")
        if lacks_directions(_chain(subject, arm)):
            _check_upright(subject, arm, subject.body, findings)
    if most == 0.0:
        tips = "; ".join(
            f"the tip of {arm.name} starts at "
            f"{subject.robot.link_pose(subject.q, arm.tip_frame).translation.round(3).tolist()}"
            for arm in arms
        )
        findings.wrong(
            f"target_volume = {subject.parameters['target_volume']}: no arm reaches any of {POSES} "
            f"random poses in it; it counts from {subject.robot.root_link}, where {tips}"
        )


def reached_share(subject: Subject, arm: Arm, grasp: int, volume: TargetVolume) -> float:
    """Of poses at random places in V, standing on a random face, turned at random.

    Arms that move their tip in fewer than six directions may turn the object otherwise.
    """
    assert subject.body is not None
    rng, faces = np.random.default_rng(1), subject.body.faces
    chosen = [faces[k].T_face_object for k in rng.integers(len(faces), size=POSES)]
    placed = [(_pose_in(volume, rng) * T, T) for T in chosen]
    T_tip_object, q, chain = arm.grasps[grasp], subject.q[arm.q_index], _chain(subject, arm)
    ik = InverseKinematics(chain)
    if lacks_directions(chain):
        any_turn = FreeYawIK(chain, T_tip_object, ik)
        return float(np.mean([bool(any_turn.placed(*each, 31, rng, q)) for each in placed]))
    tips = [(T * T_tip_object.inverse()).homogeneous for T, _ in placed]
    seeds = ik.random_seeds(rng, (POSES, 31))
    seeds = np.concatenate([np.broadcast_to(q, (POSES, 1, arm.dof)), seeds], axis=1)
    return float((ik.solve_batch(np.array(tips), seeds)[1] > 0).mean())


def _chain(subject: Subject, arm: Arm) -> Chain:
    return Chain.from_robot(subject.robot, arm, subject.q)


def _check_upright(subject: Subject, arm: Arm, body: Body, findings: Findings) -> None:
    """Say of an arm of few directions what that means, and whether it can stand the object up."""
    chain = _chain(subject, arm)
    findings.say(
        f"{arm.name}: its joints move the tip in {chain.freedom} of {POSE_DIMENSIONS} directions; "
        "it puts the object down turned about the vertical as it can"
    )
    tolerance = IKSettings().rotation_tolerance
    held = (
        (grasp * face.T_face_object.inverse()).homogeneous
        for grasp in arm.grasps
        for face in body.faces
    )
    hindrance = most_upright(chain, held, tolerance).hindrance(tolerance)
    if hindrance:
        findings.wrong(
            f"{arm.name}.grasps: the arm {hindrance}; hold the object so that the joints can bring "
            "it upright, exactly, or name an arm with more joints that move independently"
        )


def _pose_in(volume: TargetVolume, rng: np.random.Generator) -> pin.SE3:
    """Upright anywhere in V, in each of its boxes as often as it is large."""
    boxes = volume.joined
    sizes = (boxes[:, 1] - boxes[:, 0]).prod(axis=1)
    place = rng.uniform(*boxes[rng.choice(len(boxes), p=sizes / sizes.sum())])
    return pin.SE3(pin.utils.rotate("z", rng.uniform(-math.pi, math.pi)), place)


def check_planner(subject: Subject, findings: Findings) -> None:
    """Say whether a planner can be made over a plane through V, and what it does without."""
    arms = tuple(arm for arm in subject.arms if arm.grasps)
    if subject.body is None or not arms:
        return
    findings.title("a planner, over a plane at the bottom of target_volume")
    began = time.process_time()
    try:
        with stoppable(lambda: time.process_time() > began + PREPARATION_LIMIT_S):
            planner = _planner(subject, arms, subject.body)
    except StoppedError:
        findings.say(f"a planner is not made within {PREPARATION_LIMIT_S:g} s of processor time")
        return
    except PlacementPlannerError as error:
        findings.say("no planner can be made, for what is wrong below")
        findings.wrong(error)
        return
    findings.say(f"making one: {time.process_time() - began:.2f} s")
    for words in planner.unusable:
        findings.say(f"does without {words}")


def _planner(subject: Subject, arms: tuple[Arm, ...], body: Body) -> PlacementPlanner:
    robot, parameters = subject.robot, subject.parameters
    plane = (PointSet(_plane_in(parameters.volume)),)
    snapshot = Snapshot(robot, arms, subject.q, body, plane, parameters, robot.root_link)
    return make_planner(snapshot, Surroundings.of(snapshot).environment())


def _plane_in(volume: TargetVolume) -> Array:
    """(n, 3) points every 5 mm, more than a cell above the bottom of each of V's boxes."""
    planes = []
    for low, high in volume.joined:
        x, y = (np.arange(low[i], high[i], 0.005) for i in range(2))
        height = low[2] + min(0.02, 0.1 * (high[2] - low[2]))
        grid = np.meshgrid(x, y, [height], indexing="ij")
        planes.append(np.column_stack([axis.ravel() for axis in grid]))
    return np.concatenate(planes)
