"""Arms of few joints: what they can give at a place, and how they go on from there."""

import numpy as np
import pinocchio as pin
import pytest
from helpers import few_joints

from placement_planner_ros.core.contacts.face import placement_pose
from placement_planner_ros.core.grasp.free_yaw_ik import FreeYawIK
from placement_planner_ros.core.objective.objective import moved_pose
from placement_planner_ros.core.reach.ik import InverseKinematics
from placement_planner_ros.core.reach.kinematics import Chain
from placement_planner_ros.core.robot.model import Robot

HELD = [
    ("five", few_joints.FROM_ASIDE),
    ("five aside", few_joints.FROM_ABOVE),
    ("four", few_joints.FROM_ABOVE),
    ("four aside", few_joints.FROM_ASIDE),
    ("scara", few_joints.FROM_ABOVE),
]


class Hand:
    """An arm, what it holds, and the face on which that stands upright."""

    def __init__(self, name, grasp, text=None):
        self.robot = Robot.from_urdf(few_joints.urdf_of(name) if text is None else text)
        self.arm = self.robot.arm("arm", "tip")
        self.grasp = grasp
        start = {j: few_joints.start_of(name).get(j, 0.0) for j in self.robot.joint_names}
        self.q = self.robot.configuration(start)
        self.chain = Chain.from_robot(self.robot, self.arm, self.q)
        self.ik = InverseKinematics(self.chain)
        self.any_turn = FreeYawIK(self.chain, grasp, self.ik)
        faces = few_joints.body().faces
        self.face = min(faces, key=lambda face: face.normal[2])

    def object_pose(self, q):
        """By pinocchio, from the URDF."""
        whole = self.q.copy()
        whole[self.arm.q_index] = q
        return self.robot.link_pose(whole, "tip") * self.grasp


@pytest.fixture(scope="module", params=HELD, ids=[name for name, _ in HELD])
def hand(request):
    return Hand(*request.param)


def assert_reached(hand, x, q):
    """As exactly as with any arm: the tolerances of the tip, at an object 0.1 m from it."""
    away = x.actInv(hand.object_pose(q))
    assert np.linalg.norm(away.translation) <= 3e-5
    assert np.linalg.norm(pin.log3(away.rotation)) <= 1.01e-4
    assert (hand.chain.lower <= q).all()
    assert (q <= hand.chain.upper).all()


def turns_freely(hand):
    """Whether a joint turns about the vertical where the object is upright."""
    return hand.robot.name == "scara" or (hand.arm.dof == 5 and hand.grasp is few_joints.FROM_ABOVE)


def turn_between(hand, x, other):
    """rad about the face's normal; that nothing else differs is asserted."""
    change = (x * hand.face.T_face_object.inverse()).actInv(
        other * hand.face.T_face_object.inverse()
    )
    assert change.translation == pytest.approx(np.zeros(3), abs=1e-9)
    turn = pin.log3(change.rotation)
    assert turn[:2] == pytest.approx(np.zeros(2), abs=1e-9)
    return float(turn[2])


def test_places_are_reached_upright_and_turned_as_the_arm_can(hand):
    rng = np.random.default_rng(1)
    reached = as_asked = possible = 0
    for _ in range(30):
        place = np.array([rng.uniform(0.33, 0.5), rng.uniform(-0.25, 0.25), 0.1])
        x = placement_pose(hand.face, place, rng.uniform(0.0, 2.0 * np.pi))
        placed = hand.any_turn.placed(x, hand.face.T_face_object, 63, rng, hand.q[hand.arm.q_index])
        reached += bool(placed)
        for other, Q in placed:
            turn_between(hand, x, other)
            for q in Q:
                assert_reached(hand, other, q)
        seeds = hand.ik.chain.random(rng, (64,))
        tip = (x * hand.grasp.inverse()).homogeneous
        as_asked += len(placed) == 1 and placed[0][0] is x
        possible += len(hand.ik.solve(tip, seeds)) > 0
    assert reached >= 27
    assert as_asked >= possible
    assert (possible > 15) == turns_freely(hand)


def upright_near_the_middle(hand):
    x = placement_pose(hand.face, np.array([0.42, 0.1, 0.1]), 0.3)
    rng = np.random.default_rng(0)
    placed = hand.any_turn.placed(x, hand.face.T_face_object, 63, rng, hand.q[hand.arm.q_index])
    return placed[0][0], placed[0][1][0]


def test_a_place_is_followed_with_the_turn_that_comes(hand):
    x, q = upright_near_the_middle(hand)
    near = moved_pose(x, np.array([0.01, -0.01, 0.0]))
    other, q_next = hand.any_turn.follow(near, hand.face.T_face_object, q)
    assert abs(turn_between(hand, near, other)) <= 0.2
    assert_reached(hand, other, q_next)
    assert np.abs(q_next - q).max() <= 0.2
    far = moved_pose(x, np.array([3.0, 0.0, 0.0]))
    assert hand.any_turn.follow(far, hand.face.T_face_object, q) is None
