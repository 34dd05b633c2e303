"""ABB's home position of the YuMi: 0, -130, ±135, 30, 0, 40, 0 degrees, the fingers 40 mm apart."""

from types import MappingProxyType

from placement_planner_ros.scenes.yumi import START_CONFIGURATION

_BENT = {2: -2.268928, 3: 0.523599, 5: 0.698132}
HOME = MappingProxyType(
    START_CONFIGURATION
    | {f"yumi_joint_{n}_{side}": _BENT.get(n, 0.0) for side in "lr" for n in range(1, 8)}
    | {"yumi_joint_7_l": 2.356194, "yumi_joint_7_r": -2.356194}
)
"""Joint name -> rad or m."""
