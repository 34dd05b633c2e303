"""Errors for bad input. Expected failures of the search are values (`types.Verdict`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

NAMED_THINGS = 12
"""Things that are named at most where any number may be meant."""

MAX_PART_LETTERS = 1000
"""Characters of each part of a message, which may name what somebody else has named."""


def listed(things: Sequence[str], separator: str = ", ", most: int = NAMED_THINGS) -> str:
    """All of few things; of many the first, and how many more there are."""
    if len(things) <= most:
        return separator.join(things)
    return f"{separator.join(things[:most])} and {len(things) - most} more"


def sayable(words: str) -> str:
    """The words as text that can be sent and logged.

    ROS raises at what UTF-8 has no bytes for, as in names of files that are not UTF-8.
    """
    return words.encode(errors="replace").decode().replace("\0", "?")


def forget_where(error: BaseException) -> None:
    """Forget where an error that is to be kept was raised, and those it came from.

    Its traceback would keep all that was at hand there, as the arrays of a cloud that was refused.
    """
    known: set[int] = set()
    following: list[BaseException | None] = [error]
    while following:
        each = following.pop()
        if each is not None and id(each) not in known:
            known.add(id(each))
            each.__traceback__ = None
            following += [each.__cause__, each.__context__]


class PlacementPlannerError(Exception):
    """Root of every error this package raises for bad input.

    Args:
        field: what was wrong, as the user names it (a parameter, a link, a message field).
        value: the offending value, shown in the message in short form.
        remedy: what to do about it, a sentence.
    """

    code = "BAD_PARAMETER"

    def __init__(self, field: str, value: object, remedy: str) -> None:
        self.field = field
        self.value = value
        self.remedy = remedy
        words, most = (field, _shown_value(value), remedy), MAX_PART_LETTERS
        parts = (each if len(each) <= most else f"{each[:most]}..." for each in words)
        super().__init__("{} = {}: {}".format(*parts))


def _shown_value(value: object) -> str:
    """The value in words; of many the first."""
    if isinstance(value, list | tuple) and len(value) > NAMED_THINGS:
        return f"[{listed([repr(each) for each in value])}]"
    if isinstance(value, Mapping) and len(value) > NAMED_THINGS:
        return f"{{{listed([f'{key!r}: {each!r}' for key, each in value.items()])}}}"
    return repr(value)


class ParameterError(PlacementPlannerError):
    """A setting is out of range or of the wrong form."""


class RobotError(PlacementPlannerError):
    """The robot description, an arm or a gripper is unusable."""


class GraspError(PlacementPlannerError):
    """A grasp (pose of the object in the tip frame) is unusable."""

    code = "BAD_GRASP"


class ObjectError(PlacementPlannerError):
    """The grasped object's geometry is unusable."""

    code = "BAD_OBJECT"


class VolumeError(PlacementPlannerError):
    """The target volume is empty, inverted or not finite."""

    code = "BAD_VOLUME"


class CloudError(PlacementPlannerError):
    """A point cloud is malformed."""

    code = "NO_CLOUD"


class JointStateError(PlacementPlannerError):
    """Joint values are missing, not finite or beyond their limits."""

    code = "JOINTS_MISSING"


class StartError(PlacementPlannerError):
    """The robot's start configuration is not free with the object in hand."""

    code = "BAD_START"
