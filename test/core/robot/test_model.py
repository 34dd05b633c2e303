"""Robots from any URDF: what is derived, what is refused and in which words."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from helpers.robots import joint, link, urdf

from placement_planner_ros.core.errors import GraspError, JointStateError, RobotError, StartError
from placement_planner_ros.core.robot.model import Robot

BOX = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'


def two(*joints: str) -> str:
    return urdf(link("a"), link("b"), *joints)


def hand_urdf() -> str:
    """Two arm joints, a flange, a hand with two coupled fingers, a tool point."""
    finger = '<limit lower="0" upper="0.04" velocity="0.1" effort="1"/>'
    return urdf(
        link("base", BOX),
        link("one", BOX),
        link("two", BOX),
        link("flange"),
        link("hand", BOX),
        link("finger_a", BOX),
        link("finger_b", BOX),
        link("tool"),
        joint("j1", "base", "one"),
        joint("j2", "one", "two"),
        joint("mount", "two", "flange", "fixed", limit=None),
        joint("palm", "flange", "hand", "fixed", limit=None),
        joint("point", "hand", "tool", "fixed", limit=None),
        joint("fa", "hand", "finger_a", "prismatic", "0 0.1 0.1", finger),
        joint(
            "fb",
            "hand",
            "finger_b",
            "prismatic",
            "0 -0.1 0.1",
            finger,
            '<mimic joint="fa" multiplier="-1" offset="0.04"/>',
        ),
    )


# --- joints -------------------------------------------------------------------------------------


def test_one_coordinate_per_joint():
    robot = Robot.from_urdf(
        urdf(
            *map(link, "abcd"),
            joint("spin", "a", "b", "continuous", limit=None),
            joint("turn", "b", "c", limit='<limit lower="-1" upper="2"/>'),
            joint("lift", "c", "d", "prismatic", limit='<limit upper="1" velocity="inf"/>'),
        )
    )
    assert robot.joint_names == ("spin", "turn", "lift")
    assert robot.model.nq == robot.model.nv == 3
    assert robot.continuous == {"spin"}
    assert robot.lower[1:] == pytest.approx([-1, 0])
    assert robot.upper[1:] == pytest.approx([2, 1])
    assert robot.velocity_limits == pytest.approx([1.0, 1.0, 0.1])
    assert all("velocity" in robot.assumed[joint] for joint in robot.joint_names)
    for array in (robot.lower, robot.upper, robot.velocity_limits):
        assert not array.flags.writeable


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not xml", "`urdf`.*XML"),
        ("<sdf/>", "root element is <robot>"),
        (urdf(), "a robot has 1 to"),
        (urdf(link("a"), link("a")), "'a'.*twice"),
        (urdf(link("a"), link("b")), "several trees"),
        (urdf(link("a"), joint("j", "a", "b")), "joint j: child = 'b'"),
        (two(joint("j", "a", "b", "planar")), "joint j = 'planar'"),
        (two(joint("j", "a", "b", "floating")), "joint j = 'floating'"),
        (two(joint("j", "a", "b", limit=None)), "joint j.*<limit>"),
        (
            two(joint("j", "a", "b", limit='<limit lower="1" upper="0"/>')),
            "joint j.*lower <= upper",
        ),
        (two(joint("j", "a", "b", xyz="0 nan 0")), "joint j: origin xyz"),
        (two(joint("j", "a", "b").replace("0 1 0", "0 0 0")), "joint j: axis.*zero"),
        (two(joint("j", "a", "b", limit='<limit upper="x"/>')), "joint j: upper = 'x'"),
        (
            two(joint("j", "a", "b", "prismatic", limit='<limit lower="-inf" upper="0"/>')),
            "joint j.*finite limits",
        ),
        (
            urdf(
                link("a"),
                link("b"),
                link("c"),
                joint("j", "a", "b", more='<mimic joint="k"/>'),
                joint("k", "b", "c", more='<mimic joint="j"/>'),
            ),
            "circle",
        ),
        (urdf(link("r"), link("a"), link("b"), joint("j", "a", "b"), joint("k", "b", "a")), "loop"),
        (two(joint("j", "a", "b"), joint("k", "b", "a")), "link a = 'b'.*loop"),
    ],
)
def test_bad_descriptions_are_refused(text, message):
    with pytest.raises(RobotError, match=message):
        Robot.from_urdf(text)


# --- configurations -----------------------------------------------------------------------------


def test_configuration_fills_what_mimics():
    robot = Robot.from_urdf(hand_urdf())
    q = robot.configuration({"j1": 0.1, "j2": 0.2, "fa": 0.03, "fb": 9.0, "unrelated": np.nan})
    assert robot.joint_names == ("j1", "j2", "fa", "fb")
    assert q == pytest.approx([0.1, 0.2, 0.03, 0.01])
    moved = robot.with_positions(q, {"fa": 0.0})
    assert moved == pytest.approx([0.1, 0.2, 0.0, 0.04])
    assert q[2] == 0.03
    assert robot.with_positions(q, {"fb": 0.3}) == pytest.approx(q), "it follows"
    with pytest.raises(RobotError, match="fc"):
        robot.with_positions(q, {"fc": 0.0})


def test_configuration_names_every_missing_or_bad_joint():
    robot = Robot.from_urdf(hand_urdf())
    with pytest.raises(JointStateError, match=r"\['j1', 'fa'\]"):
        robot.configuration({"j2": 0.0})
    with pytest.raises(JointStateError, match=r"j1 = nan.*fa = inf"):
        robot.configuration({"j1": np.nan, "j2": 0.0, "fa": np.inf})


def test_limit_violations_are_told_not_raised():
    robot = Robot.from_urdf(hand_urdf())
    q = robot.configuration({"j1": -1.5, "j2": 0.5, "fa": 0.065})
    assert robot.limit_violations(q) == [
        "joint j1 = -1.5 is 0.5 beyond its limits [-1, 1]",
        "joint fa = 0.065 is 0.025 beyond its limits [0, 0.04]",
    ]
    assert robot.limit_violations(robot.configuration({"j1": 1.0, "j2": 0, "fa": 0})) == []


def test_mimic_of_a_mimic_is_followed_to_the_end():
    text = hand_urdf().replace(
        "</robot>",
        link("tip")
        + joint("fc", "finger_b", "tip", "prismatic", more='<mimic joint="fb" multiplier="2"/>')
        + "</robot>",
    )
    robot = Robot.from_urdf(text)
    q = robot.configuration({"j1": 0, "j2": 0, "fa": 0.03})
    assert q[robot.index("fc")] == pytest.approx(2 * 0.01)


# --- arms ---------------------------------------------------------------------------------------


def test_a_robot_is_the_same_seen_from_a_link_that_is_fixed_to_its_root():
    floor = joint("floor", "base", "floor", "fixed", "0.1 0.2 -0.3", limit=None)
    text = hand_urdf().replace("</robot>", f"{link('floor')}{floor}</robot>")
    robot, seen = Robot.from_urdf(text), Robot.from_urdf(text).seen_from("floor")
    q = robot.configuration({"j1": 0.3, "j2": -0.2, "fa": 0.01})
    np.testing.assert_allclose(seen.link_pose(q, "floor").homogeneous, np.eye(4), atol=1e-15)
    for each in ("base", "hand"):
        between = [r.link_pose(q, "floor").actInv(r.link_pose(q, each)) for r in (robot, seen)]
        assert between[0].isApprox(between[1])
    with pytest.raises(RobotError, match="`root frame` = 'hand': is no link fixed"):
        robot.seen_from("hand")


@pytest.mark.parametrize("tip", ["hand", "tool", "flange"])
def test_arm_is_derived(tip):
    robot = Robot.from_urdf(hand_urdf())
    grasp = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.2]))
    arm = robot.arm("arm", tip, grasps=[grasp], gripper_joints=["fa"], gripper_open=[0.04])
    assert arm.joints == ("j1", "j2")
    assert arm.dof == 2
    assert list(arm.q_index) == [0, 1]
    assert list(arm.velocity) == [2.0, 2.0]
    assert set(arm.touch_links) - {"flange"} == {"hand", "finger_a", "finger_b", "tool"}
    assert arm.grasps[0] == grasp
    q = robot.configuration({"j1": 0.0, "j2": 0.0, "fa": 0.0})
    assert robot.with_open_hand(q, arm) == pytest.approx([0, 0, 0.04, 0.0])


def test_hand_without_geometry_is_the_last_moving_link():
    robot = Robot.from_urdf(
        urdf(
            link("a", BOX),
            link("b", BOX),
            link("c", BOX),
            link("t"),
            joint("j", "a", "b"),
            joint("k", "b", "c"),
            joint("f", "c", "t", "fixed", limit=None),
        )
    )
    assert set(robot.arm("arm", "t").touch_links) == {"c", "t"}


@pytest.mark.parametrize(
    ("changed", "error", "message"),
    [
        ({"tip_frame": "nowhere"}, RobotError, "arm x: tip_frame = 'nowhere'"),
        ({"tip_frame": "base"}, RobotError, "no movable joint leads to base"),
        ({"joints": ["j1", "fa"]}, RobotError, r"on the way to hand.*: \['j1', 'j2'\]"),
        ({"joints": ["j2", "j1"]}, RobotError, r"root to tip: \['j1', 'j2'\]"),
        ({"joints": ["j1", "j1"]}, RobotError, "each once"),
        ({"joints": []}, RobotError, "no movable joint"),
        ({"tip_frame": "finger_b"}, RobotError, "fb.*mimics fa"),
        ({"tip_frame": "finger_a"}, RobotError, "fb.*mimics fa"),
        ({"touch_links": ["thumb"]}, RobotError, "touch_links = 'thumb'"),
        ({"gripper_joints": ["fa"]}, RobotError, "one value for each"),
        ({"gripper_joints": ["fb"], "gripper_open": [0.0]}, RobotError, "follows fa"),
        ({"gripper_joints": ["j1"], "gripper_open": [0.0]}, RobotError, "joint of the arm"),
        ({"gripper_joints": ["zz"], "gripper_open": [0.0]}, RobotError, "'zz'"),
        ({"gripper_joints": ["fa"], "gripper_open": [0.05]}, RobotError, "0.05.*fa's"),
        ({"grasps": [pin.SE3(2 * np.eye(3), np.zeros(3))]}, GraspError, r"grasps\[0\].*rotation"),
        ({"grasps": [pin.SE3(np.eye(3), np.full(3, np.nan))]}, GraspError, r"grasps\[0\].*finite"),
    ],
)
def test_bad_arms_are_refused(changed, error, message):
    robot = Robot.from_urdf(hand_urdf())
    with pytest.raises(error, match=message):
        robot.arm(**({"name": "x", "tip_frame": "hand"} | changed))


# --- pairs --------------------------------------------------------------------------------------


def test_pairs_are_derived_without_srdf():
    """Neighbours (through `flange`, which has no geometry), always touching."""
    robot = Robot.from_urdf(hand_urdf())
    assert set(robot.allowed_pairs) == {
        ("base", "one"),
        ("one", "two"),
        ("hand", "two"),
        ("finger_a", "hand"),
        ("finger_b", "hand"),
    }
    assert any("no SRDF: 5 pairs" in warning for warning in robot.warnings)
    stuck = urdf(
        link("a", BOX),
        link("b", BOX),
        link("c", BOX),
        joint("j", "a", "b", xyz="0 0 0.05"),
        joint("k", "b", "c", xyz="0 0 0.02"),
    )
    assert ("a", "c") in Robot.from_urdf(stuck).allowed_pairs
    assert Robot.from_urdf(stuck).allowed_pairs == Robot.from_urdf(stuck).allowed_pairs


def test_collision_pairs_are_what_moves_and_may_not_touch():
    robot = Robot.from_urdf(hand_urdf())
    links = {
        tuple(sorted((robot.geometry_links[p.first], robot.geometry_links[p.second])))
        for p in robot.geometry.collisionPairs
    }
    assert links == {
        ("base", "two"),
        ("base", "hand"),
        ("base", "finger_a"),
        ("base", "finger_b"),
        ("hand", "one"),
        ("finger_a", "one"),
        ("finger_b", "one"),
        ("finger_a", "two"),
        ("finger_b", "two"),
        ("finger_a", "finger_b"),
    }


def test_srdf():
    srdf = (
        '<robot name="test"><disable_collisions link1="two" link2="base" reason="Never"/>'
        '<disable_collisions link1="two" link2="ghost" reason="Never"/>'
        '<disable_default_collisions link="hand"/>'
        '<enable_collisions link1="hand" link2="base"/></robot>'
    )
    robot = Robot.from_urdf(hand_urdf(), srdf=srdf)
    assert ("base", "two") in robot.allowed_pairs
    assert ("hand", "one") in robot.allowed_pairs
    assert ("base", "hand") not in robot.allowed_pairs
    assert ("base", "one") not in robot.allowed_pairs
    assert any("ghost" in warning for warning in robot.warnings)
    for bad in ("nonsense", "<sdf/>"):
        with pytest.raises(RobotError, match="`srdf`"):
            Robot.from_urdf(hand_urdf(), srdf=bad)


# --- geometry -----------------------------------------------------------------------------------


def with_geometry(shape: str) -> str:
    return urdf(link("thing", f"<collision><geometry>{shape}</geometry></collision>"))


def cube(side: float = 0.1) -> str:
    corners = [(x, y, z) for x in (0, side) for y in (0, side) for z in (0, side)]
    quads = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    return "\n".join(lines + [f"f {a} {b} {c}\nf {a} {c} {d}" for a, b, c, d in quads])


def test_mesh_paths(tmp_path):
    folder = tmp_path / "my_robot" / "meshes"
    folder.mkdir(parents=True)
    (folder / "cube.obj").write_text(cube())
    packaged = with_geometry('<mesh filename="package://my_robot/meshes/cube.obj"/>')
    assert Robot.from_urdf(packaged, {"my_robot": tmp_path / "my_robot"}).geometry.ngeoms == 1
    absolute = with_geometry(f'<mesh filename="file://{folder}/cube.obj"/>')
    assert Robot.from_urdf(absolute).geometry.ngeoms == 1
    for dirs in ({}, {"my_robot": folder}, {"other": tmp_path / "my_robot"}):
        with pytest.raises(RobotError, match=r"link thing, collision 0: mesh.*no such file"):
            Robot.from_urdf(packaged, dirs)
    for name, words in (("https://x.org/c.obj", "https"), ("package:///m/c.obj", "two slashes")):
        with pytest.raises(RobotError, match=words):
            Robot.from_urdf(with_geometry(f'<mesh filename="{name}"/>'))


@pytest.mark.parametrize(("between", "reason"), [(2, "Adjacent"), (3, "Always")])
def test_links_are_neighbours_over_three_joints_at_most(between, reason):
    names = ["base", *(f"bare_{k}" for k in range(between)), "last"]
    joints = [joint(b, a, b, xyz="0 0 0") for a, b in pairwise(names)]
    bare = urdf(*map(link, names), *joints)
    text = bare.replace(link("base"), link("base", BOX)).replace(link("last"), link("last", BOX))
    assert Robot.from_urdf(text).allowed_pairs == {("base", "last"): reason}
    with pytest.raises(RobotError, match="no collision shapes"):
        Robot.from_urdf(bare).arm("arm", "last")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "cannot be read"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "(is empty|cannot be read)"),
        ("v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n", "not finite"),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no surface"),
        (cube(100.0), "100 m long.*millimetres"),
        (cube(1e-3), "0.001 m long; check its scale"),
    ],
)
def test_bad_meshes_are_refused(tmp_path, content, message):
    (tmp_path / "bad.obj").write_text(content)
    with pytest.raises(RobotError, match=rf"link thing, collision 0: mesh.*{message}"):
        Robot.from_urdf(with_geometry('<mesh filename="bad.obj"/>'), {"": tmp_path})


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ('<box size="0.1 0 0.1"/>', "link thing, collision 0: box.*positive"),
        ('<sphere radius="-1"/>', "sphere.*positive"),
        ('<cylinder radius="0.1"/>', "link thing, collision 0: length"),
        ('<box size="0.1 nan 0.1"/>', "finite"),
        ("<torus/>", "'torus'"),
        ("", "exactly one shape"),
    ],
)
def test_bad_primitives_are_refused(shape, message):
    with pytest.raises(RobotError, match=message):
        Robot.from_urdf(with_geometry(shape))


@pytest.mark.parametrize("shape", ['<box size="0 0 0"/>', '<sphere radius="0.0"/>'])
def test_shapes_of_no_size_are_left_out_and_told(shape):
    robot = Robot.from_urdf(with_geometry(shape))
    assert not robot.geometry.geometryObjects
    assert "link thing, collision 0: a shape of no size is left out" in robot.warnings


def test_links_that_are_only_drawn_are_told():
    solid = with_geometry('<box size="1 1 1"/>')
    drawn = solid.replace("collision>", "visual>")
    told = [[w for w in Robot.from_urdf(u).warnings if "<visual>" in w] for u in (solid, drawn)]
    assert told[0] == []
    assert told[1][0].startswith("thing: links with <visual> but no <collision>")


# --- whole robots -------------------------------------------------------------------------------


def test_a_mimicking_joint_may_be_where_its_master_puts_it():
    """As the PR2's parallel links, whose own limits have the wrong sign."""
    limit = '<limit lower="0" upper="1" velocity="2" effort="1"/>'
    follower = joint("b", "b", "c", limit=limit, more='<mimic joint="a" multiplier="-1"/>')
    robot = Robot.from_urdf(urdf(link("a"), link("b"), link("c"), joint("a", "a", "b"), follower))
    robot.require_plausible(robot.configuration({"a": 0.9}), ["a", "b"])
    with pytest.raises(StartError, match=r"a = 57.*publish rad or m"):
        robot.require_plausible(robot.configuration({"a": 57.0}), ["a"])
    robot.require_plausible(robot.configuration({"a": 57.0}), [])


def test_what_moves_no_shape_or_is_passive_or_follows_need_not_be_known():
    text = urdf(
        *(link(name, BOX) for name in ("base", "arm", "caster", "finger")),
        *map(link, ("camera", "tip", "guide")),
        joint("swing", "base", "arm", limit='<limit lower="0.2" upper="1" velocity="2"/>'),
        joint("pan", "base", "camera"),
        joint("wheel", "base", "caster"),
        joint("roll", "arm", "tip", limit='<limit lower="0.2" upper="1" velocity="2"/>'),
        joint("drive", "base", "guide"),
        joint("grip", "arm", "finger", more='<mimic joint="drive"/>'),
    )
    srdf = '<robot name="test"><passive_joint name="wheel"/></robot>'
    robot = Robot.from_urdf(text, srdf=srdf)
    assert set(robot.needed_joints) == {"swing", "drive"}
    known = {"swing": 0.5, "drive": 0.3, "pan": 0.4}
    q = robot.configuration(known)
    values = dict(zip(robot.joint_names, q, strict=True))
    assert values == known | {"wheel": 0.0, "roll": 0.2, "grip": 0.3}
    with pytest.raises(JointStateError, match=r"\['roll'\]"):
        robot.configuration(known, also=["roll", "pan"])


def test_what_is_barely_beyond_a_limit_is_taken_to_be_there():
    robot = Robot.from_urdf(hand_urdf())
    q = robot.configuration({"j1": -1.0005, "j2": 1.1, "fa": 0.041})
    within = robot.within_limits(q, 0.001)
    i, j, k = (robot.index(name) for name in ("j1", "j2", "fa"))
    assert (within[i], within[j], within[k]) == (-1.0, 1.1, 0.04)
    np.testing.assert_array_equal(robot.within_limits(q, 0.0), q)
