"""What lifts an object, on one column of a support map."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.stability.coplanarity import LEANS
from placement_planner_ros.core.stability.protrusions import Protrusions
from placement_planner_ros.core.types import LEVEL

NOISE, WIDTH = 0.0015, 0.04


def lifted(height, points, plane=(0.0, 0.0, 0.0), touches=(0.0, 0.0), noise=0.0003):
    """Whether a box is lifted that stands at z = 0 above one surface so high, of so many points."""
    mesh = trimesh.creation.box((WIDTH, WIDTH, WIDTH))
    body = Body.from_mesh(mesh.vertices, mesh.faces)
    down = int(np.argmin([face.normal[2] for face in body.faces]))
    support = SimpleNamespace(
        origin=np.array([-0.1, -0.1, 0.0]),
        cell_size=0.2,
        columns=(1, 1),
        start=np.array([0, 1]),
        height=np.array([height]),
        rectangle=np.array([[-0.05, -0.05, 0.05, 0.05]]),
        first=np.array([0, points]),
        noise=NOISE,
    )
    environment = SimpleNamespace(support_of=lambda slope: support)
    rises = Protrusions(environment, body.faces, lambda face: np.array([touches]), 0.003)
    T = np.eye(4)[None]
    T[0, 2, 3] = 0.5 * WIDTH
    found = rises.lift(
        T, np.array([down]), LEVEL, np.array([plane]), np.array([WIDTH]), np.array([noise])
    )
    return bool(found[0])


def test_what_is_higher_than_the_object_may_lean_and_noise_explains_lifts_it():
    most = 0.5 * LEANS * WIDTH + 0.0002 + 1.6 * 0.0003
    assert not lifted(most - 1e-5, 9)
    assert lifted(most + 1e-5, 9)
    assert not lifted(0.0031, 9)  # it collides with that


def test_it_is_held_against_the_plane_of_what_carries():
    assert lifted(0.002, 9)
    assert not lifted(0.002, 9, plane=(0.0015, 0.0, 0.0))
    assert not lifted(0.002, 9, plane=(0.0, 0.1, 0.0), touches=(0.015, 0.0))
    assert lifted(0.002, 9, plane=(0.0, 0.1, 0.0), touches=(-0.015, 0.0))


@pytest.mark.parametrize(("points", "lifts"), [(1, False), (2, False), (4, True), (9, True)])
def test_single_noisy_points_are_excused_by_their_own_error(points, lifts):
    assert lifted(0.0028, points, noise=0.0003) == lifts
