"""`placement_check_robot`: what it understands, and that it tells everything that is wrong."""

import xml.etree.ElementTree as ET

import pytest
import trimesh

from placement_planner_ros.core.robot.allowed_pairs import read_srdf
from placement_planner_ros.ros.tools import robot_check
from placement_planner_ros.ros.tools.findings import Findings
from placement_planner_ros.ros.tools.given import read_given
from placement_planner_ros.ros.tools.robot_check import main
from placement_planner_ros.scenes.yumi import start_configuration
from placement_planner_ros.share import share_path

CRAYONS = share_path("config", "small_crayons_box.yaml")


@pytest.fixture(autouse=True)
def short(request, monkeypatch):
    if "robot" in request.fixturenames:  # of too few joints for a placement
        monkeypatch.setattr(robot_check, "SEARCH_S", 0.5)


@pytest.fixture
def start(tmp_path):
    """Where the bundled robot holds the small box, as `ros2 topic echo` writes it."""
    positions = start_configuration("small_crayons_box")
    file = tmp_path / "start.yaml"
    names, values = list(positions), [float(v) for v in positions.values()]
    file.write_text(f"header: {{frame_id: ''}}\nname: {names}\nposition: {values}\n---\n")
    return file


def L_shape():
    """Two boxes as one mesh, which is not convex."""
    a = trimesh.creation.box(bounds=[[-0.02, -0.02, 0], [0.02, 0.02, 0.3]])
    b = trimesh.creation.box(bounds=[[0.02, -0.02, 0.26], [0.1, 0.02, 0.3]])
    return trimesh.util.concatenate([a, b])


@pytest.fixture
def robot(tmp_path):
    """Three joints, links of convex meshes, a hand of two fingers that close on y."""
    trimesh.creation.box((0.04, 0.04, 0.3)).export(tmp_path / "link.stl")
    links = ["base", "one", "two", "three"]
    mesh = '<collision><geometry><mesh filename="link.stl"/></geometry></collision>'
    text = "".join(f'<link name="{n}">{mesh if n in ("one", "two") else ""}</link>' for n in links)
    joints = [("base", "one", "0 0 1", 0.0), ("one", "two", "0 1 0", 0.34)]
    joints.append(("two", "three", "0 1 0", 0.34))
    for n, (parent, child, axis, z) in enumerate(joints):
        text += (
            f'<joint name="j{n}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="0 0 {z}"/><axis xyz="{axis}"/>'
            '<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>'
        )
    for side, sign in (("left", 1), ("right", -1)):
        text += (
            f'<link name="{side}"><collision><origin xyz="0 {sign * 0.01} 0.05"/><geometry>'
            '<box size="0.02 0.01 0.1"/></geometry></collision></link>'
            f'<joint name="{side}_finger" type="prismatic"><parent link="three"/>'
            f'<child link="{side}"/><axis xyz="0 {sign} 0"/>'
            '<limit lower="0" upper="0.05" velocity="0.1" effort="1"/>'
            + ('<mimic joint="left_finger"/>' if side == "right" else "")
            + "</joint>"
        )
    (tmp_path / "robot.urdf").write_text(f'<robot name="small">{text}</robot>')
    trimesh.creation.box((0.04, 0.04, 0.08)).export(tmp_path / "box.stl")
    return tmp_path


def parameters(folder, name="ok.yaml", node="placement_planner", **changes):
    values = {
        "robot_description": f"{folder}/robot.urdf",
        "arms": "[arm]",
        "arm.tip_frame": "three",
        "arm.grasps": "[0.0, 0.0, 0.08, 0.0, 0.0, 0.0, 1.0]",
        "arm.gripper_joints": "[left_finger]",
        "arm.gripper_open": "[0.04]",
        "object.mesh": f"{folder}/box.stl",
        "target_volume": "[-0.8, -0.8, 0.0, 0.8, 0.8, 1.2]",
    } | changes
    lines = "".join(f"    {key}: {value}\n" for key, value in values.items() if value is not None)
    file = folder / name
    file.write_text(f"{node}:\n  ros__parameters:\n{lines}")
    return file


def faults(said):
    """The list at the end, by its numbers."""
    _, found, listed = said.rpartition(" wrong\n")
    assert found, said
    return " ".join(listed.split())


def test_the_bundled_robot_could_plan(start, tmp_path, capsys):
    arguments = ["--params-file", str(CRAYONS), "--joints", str(start)]
    assert main([*arguments, "--write-srdf", str(tmp_path / "a.srdf")]) == 0
    said = capsys.readouterr().out
    for words in ("bundled YuMi", "arm left: 7 joints to gripper_l_base", "yumi_joint_7_l", "2.505",
                  "acceleration 5,", "a placement after ", "nothing is wrong"):  # fmt: skip
        assert words in said, words
    given = read_srdf(share_path("urdf", "yumi.srdf").read_text(), links_of("yumi.urdf"))[0]
    written = read_srdf((tmp_path / "a.srdf").read_text(), links_of("yumi.urdf"))[0]
    assert written == given


def links_of(name):
    return tuple(e.get("name") for e in ET.parse(share_path("urdf", name)).getroot().iter("link"))


def test_a_start_in_collision_is_wrong_and_said_to_be_assumed(tmp_path, capsys):
    trimesh.creation.box((0.04, 0.05, 0.1)).export(tmp_path / "box.stl")
    (tmp_path / "own.yaml").write_text(
        "/**:\n  ros__parameters:\n    arms: [left]\n    left: {tip_frame: gripper_l_base, "
        "grasps: [0.0, 0.0, 0.16, 0.0, 0.0, 0.0, 1.0]}\n"
        f"    object: {{mesh: {tmp_path}/box.stl}}\n"
        f"    robot_description: {share_path('urdf', 'yumi.urdf')}\n"
    )
    assert main(["--params-file", str(tmp_path / "own.yaml")]) == 1
    said = capsys.readouterr().out
    assert "no start is given: all joints are assumed at zero" in said
    assert "self-collision" in faults(said)


def test_meshes_joint_states_and_touch_are_told_and_drawn(robot, capsys):
    L_shape().export(robot / "link.stl")
    picture, srdf = robot / "a.png", robot / "a.srdf"
    file = parameters(robot)
    main(["--params-file", str(file), "--picture", str(picture), "--write-srdf", str(srdf)])
    said = capsys.readouterr().out
    assert "j0, j1, j2, left_finger\n" in said  # no mimicking joint
    assert "right_finger = 1 · left_finger + 0" in said
    assert "pairs of neighbouring links are left out" in said
    assert "<disable_collisions" in srdf.read_text()
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert picture.stat().st_size > 20_000


def test_everything_that_is_wrong_is_told_in_one_list(robot, capsys):
    file = parameters(
        robot,
        **{
            "robot_description": f"{robot}/robot.urdf",
            "arm.tip_frame": "thre",
            "arm.gripper_joints": "[left_fingr]",
            "arm.touch_links": "[rigth]",
            "arm.grasps": "[0.0, 0.0, 0.08, 0.0, 0.0, 1.0]",
            "target_volume": "[0.5, -0.8, 0.0, 0.4, 0.8, 1.2]",
            "object.mesh": f"{robot}/bx.stl",
            "colision_margin": "0.01",
            "collision_margin": "-1.0",
            "time_limit": None,
            "acceleration_limits": "[5, 1.0]",
        },
    )
    (robot / "start.yaml").write_text("j0: 0.1\nj_1: 0.2\nj2: 9.0\n")
    assert main(["--params-file", str(file), "--joints", str(robot / "start.yaml")]) == 1
    told = capsys.readouterr().out
    assert "the nearest is collision_margin" in " ".join(told.split())
    said = faults(told)
    for words in ("thre", "arm.grasps", "target_volume", "bx.stl",
                  "collision_margin = -1",
                  "missing = ['j1', 'left_finger']",
                  "ROS refuses a list of integers and other"):  # fmt: skip
        assert words in said, words


def test_a_grasp_in_which_nothing_holds_the_object_is_worth_a_look(robot, capsys):
    file = parameters(robot, **{"arm.grasps": "[0.0, 0.0, 0.4, 0.0, 0.0, 0.0, 1.0]"})
    main(["--params-file", str(file)])
    remarks, _, wrong = (
        capsys.readouterr().out.partition("though the node would plan")[2].partition(" wrong\n")
    )
    assert "from the object; unless something holds it" in " ".join(remarks.split())
    assert "unless something holds it" not in wrong


def test_files_that_are_not_there_are_in_the_list(tmp_path, capsys):
    missing = str(tmp_path / "missing" / "file")
    assert main(["--urdf", missing, "--srdf", missing]) == 1
    assert f"there is no file {missing}" in " ".join(capsys.readouterr().out.split())


def test_without_arms_that_is_wrong(robot, capsys):
    assert main(["--urdf", str(robot / "robot.urdf"), "--object", str(robot / "box.stl")]) == 1
    assert "set arms and, of each, tip_frame" in faults(capsys.readouterr().out)


def read(file):
    """Parameters of a file, and what is wrong with them."""
    findings = Findings()
    return read_given(file, {}, findings).parameters, findings.faults


@pytest.mark.parametrize(
    ("node", "right"),
    [
        ("/**", True),
        ("/some/where/placement_planner", True),
        ("placement_planer", False),
        ("another", False),
    ],
)
def test_which_nodes_parameters_count(robot, node, right):
    given, wrong = read(parameters(robot, node=node))
    assert (given["arms"] == ["arm"]) == right
    assert (wrong == []) == right
    assert right or "it has no parameters for placement_planner" in wrong[0]
