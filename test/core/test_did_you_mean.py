import pytest

from placement_planner_ros.core.did_you_mean import did_you_mean
from placement_planner_ros.ros.parameters.table import arm_specs, fixed_specs

NAMES = [spec.name for spec in [*fixed_specs(), *arm_specs("left", yumi=True)]]


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("colision_margin", "collision_margin"),
        ("timelimit", "time_limit"),
        ("TimeLimit", "time_limit"),
        ("cell_size", "cloud.cell_size"),
        ("cloud_mode", "cloud.mode"),
        ("cloud.max-age", "cloud.max_age"),
        ("left.tipframe", "left.tip_frame"),
        ("target_volumes", "target_volume"),
        ("self_filter.enable", "self_filter.enabled"),
        ("xyz", None),
        ("", None),
        ("wheel_radius", None),
    ],
)
def test_a_slip_of_the_pen_is_recognised(name, meant):
    assert did_you_mean(name, NAMES) == meant


def test_one_letter_left_out_is_nearest_to_the_name():
    assert [did_you_mean(name[:-2] + name[-1], NAMES) for name in NAMES] == NAMES
