"""A consistent set of the parameters' values, and the settings made from them."""

from __future__ import annotations

import copy
from array import array
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import pinocchio as pin

from placement_planner_ros.core.body.settings import BodySettings
from placement_planner_ros.core.did_you_mean import did_you_mean
from placement_planner_ros.core.errors import NAMED_THINGS, ParameterError, PlacementPlannerError
from placement_planner_ros.core.planner import PlannerSettings
from placement_planner_ros.core.scene.grid import GridSettings
from placement_planner_ros.core.scene.regions import RegionSettings
from placement_planner_ros.core.settings import Settings
from placement_planner_ros.core.types import TargetVolume
from placement_planner_ros.ros.node_words import SETTINGS
from placement_planner_ros.ros.parameters.checks import named_numbers, poses_from_list
from placement_planner_ros.ros.parameters.spec import Spec
from placement_planner_ros.ros.parameters.table import KINDS

_JOINT_LIMITS = "robot_description_planning.joint_limits."
"""How the names of limits begin that MoveIt's launch files give one by one."""
NO_SUCH = "there is no such parameter"


class ParameterSet:
    """Specifications and a consistent set of values; immutable.

    Args:
        specs: every parameter.
        values: by name; defaults where one is missing.
        given: all that was given at start-up, MoveIt's limits among it.

    Attributes:
        joint_limits: MoveIt's limits that were given one by one, by `<joint>.<what>`.
        planner_settings: settings of the planner.
        grid_settings: settings of the obstacle set.
        region_settings: what counts as a placement region.
        body_settings: how the object's mesh becomes a body.

    Raises:
        PlacementPlannerError: a value, or the values together, are bad.
    """

    planner_settings: PlannerSettings
    grid_settings: GridSettings
    region_settings: RegionSettings
    body_settings: BodySettings

    def __init__(
        self,
        specs: Mapping[str, Spec],
        values: Mapping[str, object] | None = None,
        given: Mapping[str, Any] | None = None,
    ) -> None:
        self.specs = specs
        self.joint_limits: dict[str, Any] = {
            name.removeprefix(_JOINT_LIMITS): value
            for name, value in (given or {}).items()
            if name.startswith(_JOINT_LIMITS)
        }
        self._values = {name: spec.default for name, spec in specs.items()}
        self._take({name: specs[name].convert(value) for name, value in (values or {}).items()})

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def changed(self, changes: Mapping[str, object]) -> ParameterSet:
        """A copy with some values replaced.

        Raises:
            PlacementPlannerError: the first of what is wrong.
        """
        made = self.changed_or_faults(changes)
        if isinstance(made, list):
            raise made[0]
        return made

    def changed_or_faults(
        self, changes: Mapping[str, object]
    ) -> ParameterSet | list[PlacementPlannerError]:
        """A copy with some values replaced; or everything for which there is none: unknown names,
        start-up parameters, bad values, or else values that do not go together."""
        unknown, values = self.unknown(changes), dict[str, Any]()
        faults: list[PlacementPlannerError] = []
        # What is here has been checked: that a start is quick, only the changes are.
        for name, value in changes.items():
            try:
                if name in unknown:
                    shown = value.tolist() if isinstance(value, array) else value
                    raise ParameterError(name, shown, unknown[name])
                values[name] = self.convert(name, value)
            except PlacementPlannerError as error:
                faults.append(error)
        if faults or not changes:
            return faults or self
        other = copy.copy(self)
        try:
            other._take(values)
        except PlacementPlannerError as error:
            return [error]
        return other

    def unknown(self, names: Iterable[str]) -> dict[str, str]:
        """Those names that no parameter has, and what to do instead."""
        return {
            name: self._instead(name) if i < NAMED_THINGS else NO_SUCH
            for i, name in enumerate(name for name in names if name not in self.specs)
        }

    def _instead(self, name: str) -> str:
        group, _, part = name.rpartition(".")
        if group == "sensor_poses":
            return f"{NO_SUCH}, as sensor_frames did not name {part!r} at start-up"
        meant = did_you_mean(name, list(self.specs))
        return NO_SUCH if meant is None else f"{NO_SUCH}; the nearest is {meant}"

    def convert(self, name: str, value: object) -> Any:
        """A new value of a parameter in its type.

        Raises:
            PlacementPlannerError: it is bad, or other than the one read at start-up.
        """
        spec = self.specs[name]
        converted = spec.convert(value)
        # the same value may be given again, as with a whole file
        if spec.startup and converted != self[name]:
            raise ParameterError(name, value, "is read at start-up; set it there")
        return self[name] if spec.startup else converted

    @property
    def volume(self) -> TargetVolume:
        """V."""
        return TargetVolume.of_numbers(self["target_volume"])

    @property
    def assumed_joints(self) -> dict[str, float]:
        """Values of joints that nobody publishes, rad or m."""
        return named_numbers("assumed_joints", self["assumed_joints"])

    @property
    def padding_of(self) -> dict[str, float]:
        """The self-filter's padding of links that have one of their own, metres."""
        return named_numbers("self_filter.padding_of", self["self_filter.padding_of"])

    def sensor_pose(self, frame: str) -> pin.SE3 | None:
        """Pose of a sensor's frame in the planning frame, where one is given."""
        name = f"sensor_poses.{frame}"
        if name not in self.specs or not self[name]:
            return None
        return poses_from_list(name, self[name])[0]

    def _take(self, values: Mapping[str, Any]) -> None:
        """Replace values, and make the settings: once, as a start asks for them again and again."""
        self._values = {**self._values, **values}
        if not self["arms"]:
            raise ParameterError("arms", self["arms"], "name at least one arm")
        for arm in self["arms"]:
            if f"{arm}.tip_frame" not in self.specs:
                words = "this arm was not among arms at start-up, so it has no parameters"
                raise ParameterError("arms", arm, words)
        for name, kind in KINDS.items():
            setattr(self, name, self._made(kind(), SETTINGS[name]))

    def _made(self, settings: Settings, paths: Mapping[str, str]) -> Any:
        """These settings with the values of parameters in the fields at their paths."""
        # fields by the settings that hold them: "ik.sweep_step" is sweep_step of ik
        groups: dict[str, dict[str, Any]] = {"": {}}
        for name, path in paths.items():
            group, _, field = path.rpartition(".")
            value = self[name]
            value = tuple(value) if isinstance(value, list) else value
            groups.setdefault(group, {})[field] = value
        own = groups.pop("")
        inner = {g: replace(getattr(settings, g), **values) for g, values in groups.items()}
        return replace(settings, **own, **inner)
