"""V as the union of boxes, against brute force over points."""

import pickle

import numpy as np
import pytest

from placement_planner_ros.core.boxes import disjoint_rectangles
from placement_planner_ros.core.errors import VolumeError
from placement_planner_ros.core.types import MAX_BOXES, TargetVolume


def random_boxes(rng, count, sides=3):
    """(count, 2, sides) boxes with corners on a coarse grid, so that many abut and overlap."""
    low = rng.integers(0, 8, (count, sides))
    return np.stack([low, low + rng.integers(1, 5, (count, sides))], axis=1) / 10.0


def inside(boxes, points):
    return ((points[:, None] >= boxes[:, 0]) & (points[:, None] <= boxes[:, 1])).all(axis=2)


def test_several_boxes_are_their_union():
    rng = np.random.default_rng(0)
    for count in (1, 2, 5, 12, MAX_BOXES):
        boxes = random_boxes(rng, count)
        volume = TargetVolume(boxes[:, 0], boxes[:, 1])
        faces = rng.integers(-1, 14, (500, 3)) / 10.0  # on faces and corners
        points = np.vstack([rng.uniform(-0.1, 1.3, (500, 3)), faces])
        expected = inside(boxes, points).any(axis=1)
        np.testing.assert_array_equal(volume.contains(points), expected)
        assert expected.any() or count == 1
        np.testing.assert_array_equal(volume.lower, boxes[:, 0].min(axis=0))
        np.testing.assert_array_equal(volume.upper, boxes[:, 1].max(axis=0))
        np.testing.assert_array_equal(volume.boxes, boxes)
        assert pickle.loads(pickle.dumps(volume)).same(volume)
        for z in (*rng.uniform(0.0, 1.2, 3), 0.3):
            section = volume.section(z)
            cut = np.c_[points[:, :2], np.full(len(points), z)]
            np.testing.assert_array_equal(
                inside(section, points[:, :2]).any(axis=1), inside(boxes, cut).any(axis=1)
            )


def test_rectangles_are_disjoint_and_depend_on_the_union_alone():
    rng = np.random.default_rng(2)
    for count in (1, 3, 10, 40):
        boxes = random_boxes(rng, count, 2)
        found = disjoint_rectangles(boxes)
        points = rng.uniform(-0.1, 1.3, (2000, 2))
        times = inside(found, points).sum(axis=1)
        np.testing.assert_array_equal(times, inside(boxes, points).any(axis=1))
        pieces = []  # the same union by other rectangles
        for low, high in boxes:
            at = rng.uniform(low[0], high[0])
            pieces += [[low, [at, high[1]]], [[at, low[1]], high]]
        pieces = np.array(pieces)[rng.permutation(2 * count)]
        np.testing.assert_array_equal(disjoint_rectangles(pieces), found)
    assert len(disjoint_rectangles(np.zeros((0, 2, 2)))) == 0


GOOD = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ([], "six numbers for each box"),
        (GOOD[:5], "six numbers for each box"),
        ([*GOOD, 1.0], "six numbers for each box"),
        ([*GOOD, 0.0, 0.0, 2.0, 1.0, 1.0, 1.0], "minimum corner first.*box 2 of 2"),
        (["left", *GOOD[1:]], "six finite numbers"),
        ([GOOD, GOOD[:3]], "six finite numbers"),
        ([*GOOD[:5], float("nan"), *GOOD], "finite numbers.*box 1 of 2"),
        (GOOD * (MAX_BOXES + 1), f"{MAX_BOXES + 1} boxes': give {MAX_BOXES} at most"),
    ],
)
def test_bad_boxes_are_refused_by_name(numbers, words):
    with pytest.raises(VolumeError, match=f"^`volume` = .*{words}"):
        TargetVolume.of_numbers(numbers)
