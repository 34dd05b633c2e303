"""Poses from messages and parameters, and as the page's scene wants them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import Pose


def pose_of_numbers(values: Sequence[float]) -> pin.SE3:
    """A pose from x y z qx qy qz qw; the quaternion need not be of unit length.

    Raises:
        ValueError: it is none.
    """
    numbers = np.array(values, dtype=np.float64)
    if numbers.shape != (7,) or not np.isfinite(numbers).all() or not numbers[3:].any():
        raise ValueError(f"{list(values)} is no pose")
    numbers[3:] /= np.linalg.norm(numbers[3:])
    return pin.XYZQUATToSE3(numbers)


def pose_of(message: Pose) -> pin.SE3:
    """A pose from a message.

    Raises:
        ValueError: it is none.
    """
    p, r = message.position, message.orientation
    return pose_of_numbers([p.x, p.y, p.z, r.x, r.y, r.z, r.w])


def wxyz(T: pin.SE3) -> tuple[float, float, float, float]:
    """The rotation as a quaternion, real part first."""
    x, y, z, w = (float(v) for v in pin.Quaternion(T.rotation).normalized().coeffs())
    return w, x, y, z
