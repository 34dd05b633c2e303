import numpy as np
import pinocchio as pin
import pytest
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from placement_planner_ros.core.errors import CloudError
from placement_planner_ros.core.measured_points import measured_points
from placement_planner_ros.ros.inputs.point_cloud import (
    FAR_M,
    coordinates_from_message,
    message_from_points,
    points_from_message,
)

POINTS = np.array([[0.5, -1.0, 2.0], [3.0, 4.0, -5.5], [0.25, 0.0, 1.0]])


def cloud(names="xyz", kind="f4", big=False, step=None, start=0, width=3, height=1, row_pad=0):
    """POINTS with fields in that order, at that offset and byte order, padded as told."""
    size = int(kind[1])
    step = step or start + size * len(names)
    dtype = np.dtype(
        {
            "names": list(names),
            "formats": [(">" if big else "<") + kind] * len(names),
            "offsets": [start + size * i for i in range(len(names))],
            "itemsize": step,
        }
    )
    rows = np.zeros(len(POINTS), dtype=dtype)
    for i, axis in enumerate("xyz"):
        if axis in names:
            rows[axis] = POINTS[:, i]
    data = b"".join(
        rows[r * width : (r + 1) * width].tobytes() + b"\xff" * row_pad for r in range(height)
    )
    code = PointField.FLOAT32 if kind == "f4" else PointField.FLOAT64
    return PointCloud2(
        height=height,
        width=width,
        fields=[
            PointField(name=n, offset=start + size * i, datatype=code, count=1)
            for i, n in enumerate(names)
        ],
        is_bigendian=big,
        point_step=step,
        row_step=step * width + row_pad,
        data=data,
    )


@pytest.mark.parametrize(
    "layout",
    [
        {},
        {"kind": "f8"},
        {"names": "zyx"},
        {"names": "ixyz"},
        {"big": True},
        {"big": True, "kind": "f8"},
        {"step": 32, "start": 4},
        {"start": 3, "step": 17},
        {"width": 1, "height": 3, "row_pad": 7},
    ],
    ids=str,
)
def test_every_layout_gives_the_same_points(layout):
    np.testing.assert_array_equal(points_from_message(cloud(**layout)), POINTS)


def test_what_is_no_measurement_is_left_out():
    points = np.vstack([POINTS, [np.nan, 0, 0], [0, np.inf, 0], [0, 0, 0]])
    message = message_from_points(points, Header(frame_id="a"))
    assert not message.is_dense
    np.testing.assert_array_equal(points_from_message(message), POINTS)
    coordinates = coordinates_from_message(message)
    np.testing.assert_array_equal(measured_points(coordinates, np.eye(4), FAR_M), POINTS)


def broken(**changes):
    message = cloud()
    for name, value in changes.items():
        setattr(message, name, value)
    return message


@pytest.mark.parametrize(
    ("message", "named"),
    [
        (broken(data=b"\0" * 35), "data"),
        (broken(data=b"\0" * 48), "data"),
        (broken(width=4), "data"),
        (broken(height=2, row_step=12), "row_step"),
        (broken(point_step=8), "field z"),
        (broken(fields=cloud().fields[:2]), "field z"),
        (broken(fields=[]), "field x"),
        (cloud(names="xy"), "field z"),
    ],
)
def test_contradicting_sizes_are_named(message, named):
    with pytest.raises(CloudError, match=named):
        points_from_message(message)


@pytest.mark.parametrize("layout", [{}, {"kind": "f8"}, {"start": 3, "step": 17}], ids=str)
def test_points_come_in_the_frame_asked_for(layout):
    T = pin.SE3(pin.utils.rotate("z", 0.7), np.array([1.0, -2.0, 0.5]))
    moved = measured_points(coordinates_from_message(cloud(**layout)), T.homogeneous, FAR_M)
    np.testing.assert_allclose(moved, POINTS @ T.rotation.T + T.translation, atol=1e-12)
