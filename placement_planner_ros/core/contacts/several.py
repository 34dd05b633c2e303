"""Several contact classes as one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from placement_planner_ros.core.collision.arm import CollisionSettings
from placement_planner_ros.core.contacts.contact_class import ContactClass, Missing
from placement_planner_ros.core.contacts.face import FaceContact
from placement_planner_ros.core.contacts.lean import LeanContact
from placement_planner_ros.core.contacts.support_settings import SupportSettings
from placement_planner_ros.core.problem import Problem
from placement_planner_ros.core.scene.regions import Region
from placement_planner_ros.core.search.hierarchy import Ranges
from placement_planner_ros.core.types import Array, Contact, Index, Mask, Resting, Slope
from placement_planner_ros.core.wishes.turns import Turns


def contact_classes(
    problem: Problem, footing: SupportSettings, collision: CollisionSettings, turns: Turns | None
) -> tuple[FaceContact, ContactClass]:
    """The class of faces, by which placement faces are bounded, and all that are asked for as one.

    Args:
        collision: c_f(x)'s margin, and how far from what carries it the object may be.
        turns: the rules about how the object is turned; None without.
    """
    faces = FaceContact(problem, footing, collision, turns)
    if "lean" not in footing.contacts:
        return faces, faces
    lean = LeanContact(problem, footing, collision)
    return faces, SeveralContacts([faces, lean]) if "face" in footing.contacts else lean


def need_a_face(contacts: Sequence[str]) -> bool:
    """Whether an object without placement face can be placed by none of these classes."""
    return "lean" not in contacts


class SeveralContacts:
    """Contact classes one after the other: their features are numbered through."""

    def __init__(self, classes: Sequence[ContactClass]) -> None:
        self._classes = tuple(classes)
        self._first = np.cumsum([0, *(len(each.references) for each in classes)])
        self.references = np.concatenate([each.references for each in classes])
        self.frames = tuple(frame for each in classes for frame in each.frames)
        self._of_region = {region: each for each in classes for region in each.regions}

    @property
    def regions(self) -> tuple[Region, ...]:
        """Those of all classes."""
        return tuple(self._of_region)

    def ranges(self, feature: int, region: Region) -> Ranges:
        """None on regions of another class."""
        own, number = self._own(feature)
        return own.ranges(number, region) if self._of_region[region] is own else ()

    def poses(self, features: Index, points: Array, angles: Array, slopes: Array | None) -> Array:
        """(n, 4, 4), each by its class."""
        T = np.empty((len(features), 4, 4))
        for own, numbers, rows in self._parts(features):
            of_rows = None if slopes is None else slopes[rows]
            T[rows] = own.poses(numbers, points[rows], angles[rows], of_rows)
        return T

    def stable(self, T: Array, features: Index, slope: Slope) -> Mask:
        """(n,) s(x), each by its class."""
        result = np.zeros(len(T), np.bool_)
        for own, numbers, rows in self._parts(features):
            result[rows] = own.stable(T[rows], numbers, slope)
        return result

    def held(self, T: Array, features: Index) -> Mask:
        """(n,) what is left of it, each by its class."""
        result = np.zeros(len(T), np.bool_)
        for own, numbers, rows in self._parts(features):
            result[rows] = own.held(T[rows], numbers)
        return result

    def free(self, T: Array, features: Index, heights: Array, raised: float, slope: Slope) -> Mask:
        """(n,) c_f(x), each by its class."""
        result = np.zeros(len(T), np.bool_)
        for own, numbers, rows in self._parts(features):
            result[rows] = own.free(T[rows], numbers, heights[rows], raised, slope)
        return result

    def opening(self, feature: int) -> Array:
        """(3,) as its class has it."""
        own, number = self._own(feature)
        return own.opening(number)

    def moved(self, T_world_object: pin.SE3, contact: Contact, change: Array) -> pin.SE3 | None:
        """As its class has it."""
        own, number = self._own(contact.feature)
        return own.moved(T_world_object, contact._replace(feature=number), change)

    def excluded(self, features: Index, heights: Array, low: Array, high: Array) -> Mask:
        """(n,) each by its class."""
        result = np.zeros(len(features), np.bool_)
        for own, numbers, rows in self._parts(features):
            result[rows] = own.excluded(numbers, heights[rows], low[rows], high[rows])
        return result

    def resting(self, T_world_object: pin.SE3, feature: int) -> Resting:
        """As its class has it."""
        own, number = self._own(feature)
        return own.resting(T_world_object, number)

    def missing(self) -> Missing | None:
        """What the first class lacks that lacks something."""
        return next((found for each in self._classes if (found := each.missing())), None)

    def _own(self, feature: int) -> tuple[ContactClass, int]:
        which = int(self._first.searchsorted(feature, side="right")) - 1
        return self._classes[which], feature - int(self._first[which])

    def _parts(self, features: Index) -> list[tuple[ContactClass, Index, Index]]:
        """Each class with the numbers that its features have there, and the rows they are in."""
        found = []
        for each, low, high in zip(self._classes, self._first[:-1], self._first[1:], strict=True):
            rows = np.flatnonzero((features >= low) & (features < high))
            if len(rows):
                found.append((each, features[rows] - low, rows))
        return found
