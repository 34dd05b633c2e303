import numpy as np
import pinocchio as pin
import pytest
import trimesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.robot.model import Robot
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.ros.inputs.self_filter import Outline, near_points, outside_robot
from placement_planner_ros.scenes.objects import object_by_name

URDF = """<robot name="three">
<link name="base"><collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="ball"/>
<origin xyz="0 0 1"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="1" effort="1"/>
</joint>
<link name="ball"><collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.1"/></geometry>
</collision></link>
</robot>"""
BOX = Body.from_mesh(
    object_by_name("small_crayons_box").vertices, object_by_name("small_crayons_box").triangles
)


@pytest.fixture(scope="module")
def robot():
    return Robot.from_urdf(URDF)


def kept(robot, q, points, padding=0.0, arms=()):
    return outside_robot(np.array(points, dtype=float), robot, q, arms, BOX, padding).tolist()


def test_points_on_a_link_go_and_those_beside_it_stay(robot):
    q = np.zeros(1)
    assert kept(robot, q, [[0, 0, 0], [0.099, 0, 0], [0.101, 0, 0]]) == [False, False, True]
    assert kept(robot, q, [[0.5, 0, 1.0], [0.5, 0, 1.2]]) == [False, True]


def test_points_on_a_flat_mesh_go_and_those_above_it_stay(tmp_path):
    corners = [[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0], [-0.1, 0.1, 0.0]]
    trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]]).export(tmp_path / "sheet.stl")
    mesh = f'<mesh filename="{tmp_path}/sheet.stl"/>'
    sheet = Robot.from_urdf(URDF.replace('<box size="0.2 0.2 0.2"/>', mesh))
    points = [[0.05, 0.02, 0.0], [0.05, 0.02, 0.01], [0.11, 0.0, 0.0]]
    assert kept(sheet, np.zeros(1), points) == [False, True, True]


def test_what_is_in_a_hollow_of_a_link_stays(tmp_path):
    trimesh.creation.annulus(0.08, 0.1, 0.1).export(tmp_path / "ring.stl")
    mesh = f'<mesh filename="{tmp_path}/ring.stl"/>'
    ring = Robot.from_urdf(URDF.replace('<box size="0.2 0.2 0.2"/>', mesh))
    points = [[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.09, 0.0, 0.0], [0.078, 0.0, 0.0]]
    assert kept(ring, np.zeros(1), points, padding=0.005) == [True, True, False, False]


def test_links_may_have_a_padding_of_their_own(robot):
    points = np.array([[0.109, 0, 0], [0.5, 0, 1.109]])
    outline = Outline.of_robot(robot, np.zeros(1), 0.02, {"base": 0.001})
    assert outline.outside(points).tolist() == [True, False]


@pytest.mark.parametrize(("deviation", "groove"), [(0.0, 0.0), (0.001, 0.0), (0.001, 0.015)])
def test_only_what_is_on_the_surface_as_far_as_can_be_told_is_the_robot(robot, deviation, groove):
    rng = np.random.default_rng(0)
    sides = rng.uniform(-0.1, 0.1, (20_000, 3))
    # the shape for collisions closes a groove that cameras look into
    sides[:, 0] = 0.1 - groove * (np.abs(sides[:, 1]) < 0.03)
    sides[:, 0] += rng.normal(0.0, deviation, len(sides))
    rod = np.array([[0.108, 0.02, z] for z in np.arange(-0.1, 0.1, 0.002)])
    outline = Outline.of_robot(robot, np.zeros(1), 0.02)
    alone = [0.112, 0.107, 0.107]  # at a corner, with few points of any kind around it
    tip = np.array([[x, -0.05, 0.0] for x in np.arange(0.1105, 0.15, 0.005)])
    points = np.vstack([sides, rod, tip, alone])
    kept, near = near_points(points, outline, {}, 0.005, GridSettings())
    assert kept.sum() == len(tip) - 2
    left = {tuple(p) for p in near.common.round(6)}
    assert all(tuple(p) in left for p in [*rod.round(6), *tip[:2].round(6)])
    assert len(near.common) < len(rod) + 7
    assert near.common[:, 2].max() < 0.1


@pytest.mark.parametrize(("off", "left"), [(0.003, 5), (0.0, 0)])
def test_what_lies_between_links_stays_where_clouds_may_be_off(off, left):
    """Base and ball 12 mm from each other, and a thing between them that has no room for 8 mm."""
    close = Robot.from_urdf(URDF.replace('xyz="0 0 1"', 'xyz="-0.288 0 0"'))
    thing = np.array([[0.106, y, 0.0] for y in np.arange(-0.004, 0.005, 0.002)])
    outline = Outline.of_robot(close, np.zeros(1), 0.02)
    kept, near = near_points(thing, outline, {}, 0.008, GridSettings(), off)
    assert not kept.any()
    assert len(near.common) == left
    assert np.abs(near.common - thing[:left]).max(initial=0.0) < 0.001


@pytest.mark.parametrize("hollow", [0.0, 0.015])
def test_what_stands_within_the_object_as_another_grasp_has_it_rules_that_grasp_out(robot, hollow):
    rng = np.random.default_rng(0)
    surface = trimesh.Trimesh(BOX.vertices, BOX.triangles).sample(5000, seed=0)
    # the object's mesh may close a hollow that cameras look into
    surface[np.abs(surface[:, 0]) < 0.01, 2] *= 1.0 - hollow / BOX.vertices[:, 2].max()
    side, up = BOX.vertices[:, 0].max(), np.array([0.0, 0.0, 2.0])
    rod = np.array([[side + 0.007, 0.0, z] for z in np.arange(-0.02, 0.02, 0.001)])
    points = np.vstack([surface + rng.normal(0.0, 0.0005, surface.shape), rod]) + up
    held = {
        ("arm", grasp): Outline.of_object(BOX, pin.SE3(np.eye(3), np.array([x, 0.0, 2.0])), 0.02)
        for grasp, x in enumerate((0.0, 0.015))
    }
    nothing = Outline.of_robot(robot, np.zeros(1), 0.02)
    _, near = near_points(points, nothing, held, 0.005, GridSettings())
    true, other = (near.of_grasps["arm", grasp] for grasp in (0, 1))
    assert not held["arm", 0].look(true).inside.any()
    within = held["arm", 1].look(other).inside
    assert {tuple(p) for p in other[within].round(6)} == {tuple(p) for p in (rod + up).round(6)}
