"""The grasped object, from a topic or from parameters; the latest given wins."""

from __future__ import annotations

import threading
from collections.abc import Hashable, Iterable
from functools import partial
from typing import Literal

import numpy as np

from placement_planner_ros.core.body.body import Body
from placement_planner_ros.core.collision.attached_object import object_solids
from placement_planner_ros.core.disk_cache import digest_of
from placement_planner_ros.core.errors import ObjectError, PlacementPlannerError, forget_where
from placement_planner_ros.core.types import Array
from placement_planner_ros.ros.inputs.mesh_message import Triangles, mesh_from_lists
from placement_planner_ros.ros.inputs.mesh_process import (
    KeptMesh,
    MeshProcess,
    cover_in,
    mesh_of_file,
)
from placement_planner_ros.ros.inputs.reading import Read, Reading, State
from placement_planner_ros.ros.inputs.resources import Files
from placement_planner_ros.ros.log import Log
from placement_planner_ros.ros.parameters.values import ParameterSet

Source = Literal["none", "topic", "mesh", "vertices"]
_SOURCE_OF: dict[str, Source] = {
    "object.mesh": "mesh",
    "object.vertices": "vertices",
    "object.triangles": "vertices",
}


class NoObjectError(PlacementPlannerError):
    """Nobody said what the robot holds."""

    code = "NO_OBJECT"


class ObjectInput:
    """Makes the body from whatever was given last. Safe to use from several threads.

    Bodies are made in the background. What a value, or a file's header, shows to be wrong is told
    at once.

    Args:
        parameters: as at start-up; the file they name may be anywhere.
        files: finds mesh files.
        log: hears of what is read.

    Attributes:
        reading: where bodies are made.
    """

    def __init__(self, parameters: ParameterSet, files: Files, log: Log | None = None) -> None:
        self._lock = threading.Lock()
        self._files = files
        # what the operator names at start-up may lie anywhere
        self._operators = str(parameters["object.mesh"])
        self._log = log
        self._topic: KeptMesh | PlacementPlannerError | None = None
        self._source: Source = _source_of(parameters, ("object.vertices", "object.mesh"), "none")
        self._listed: tuple[object, object, KeptMesh] | None = None
        self.reading: Reading[Body] = Reading("object", ObjectError, _read_words, log)
        self._parameters = parameters
        self._key: Hashable = None
        self._fault: PlacementPlannerError | None = None
        self._begin(parameters)

    @property
    def key(self) -> Hashable:
        """Another one whenever another object is given."""
        return self._key, self.state

    @property
    def state(self) -> State:
        """Whether there is an object, as `~/status` says it."""
        if self._fault is not None:
            return "none" if isinstance(self._fault, NoObjectError) else "bad"
        return self.reading.state(self._key)

    def wait(self, patience: float | None = None) -> None:
        """Return once the body is there, or cannot be."""
        self.reading.wait(self._key, patience)

    def take(self, topic: tuple[Array, Triangles] | PlacementPlannerError) -> None:
        """The topic's newest mesh, (n, 3) and (t, 3), is the object from now on; where it is none
        there is no object until another comes."""
        if isinstance(topic, PlacementPlannerError):
            forget_where(topic)
        with self._lock:
            self._source = "topic"
            self._topic = topic if isinstance(topic, PlacementPlannerError) else _as_it_is(topic)
        self._begin(self._parameters)

    def parameters_changed(self, names: Iterable[str], parameters: ParameterSet) -> None:
        """Parameters were set; where they describe an object, it is the object from now on."""
        mine = [name for name in names if name.startswith("object.")]
        if not mine:
            return
        with self._lock:
            # what was given last is the object, be it by topic or by parameter
            self._source = _source_of(parameters, mine, self._source)
        self._begin(parameters)

    def check(self, parameters: ParameterSet, names: Iterable[str]) -> None:
        """Look at what parameters that are about to be set show of an object.

        Vertices and triangles may be set one after the other, so they are checked together only
        when both are given.

        Raises:
            ObjectError: no object is like that.
        """
        names = set(names)
        if "object.mesh" in names and parameters["object.mesh"]:
            self._open(parameters["object.mesh"])
        elif {"object.vertices", "object.triangles"} <= names and parameters["object.vertices"]:
            self._listed_mesh(parameters)

    def body(self, parameters: ParameterSet, overridden: Iterable[str] = ()) -> Body:
        """The object, with the centre of mass and scale of the parameters; begins to make it.

        Args:
            overridden: names of parameters that hold for this call only.

        Raises:
            NoObjectError: none was given.
            NotReadyError: it is being made.
            ObjectError: it is unusable.
        """
        key, read = self._content(parameters, overridden)
        self.reading.want(key, read)
        return self.reading.get(key)

    def _begin(self, parameters: ParameterSet) -> None:
        """Make the body that these parameters mean, and no longer the one before."""
        # whatever was the object before is none from here on
        self._parameters = parameters
        before = self._key
        try:
            key, read = self._content(parameters)
        except PlacementPlannerError as error:
            self._key, self._fault = None, error
            if self._log is not None and not isinstance(error, NoObjectError):
                self._log.repeats("object refused", str(error))
        else:
            self._key, self._fault = key, None
            self.reading.want(key, read, lasting=True)
        # the object before is given up, also while it is still being made
        if before != self._key:
            self.reading.forget(before)

    def _content(
        self, parameters: ParameterSet, overridden: Iterable[str] = ()
    ) -> tuple[Hashable, Read[Body]]:
        """What tells the object from others, and how it is made."""
        with self._lock:
            source, given = _source_of(parameters, overridden, self._source), self._topic
        # where parameters describe the object, the topic's mesh does not count
        if source != "topic":
            given = None
        if source == "mesh" and parameters["object.mesh"]:
            given = self._open(parameters["object.mesh"])
        elif source == "vertices" and parameters["object.vertices"]:
            given = self._listed_mesh(parameters)
        if given is None:
            raise NoObjectError(
                "object", "not given", "publish ~/object, or set object.mesh or object.vertices"
            )
        if isinstance(given, PlacementPlannerError):
            raise given.with_traceback(None)  # which would grow each time
        given_key, read_mesh = given
        # parts of the key, as the body depends on them too
        center, scale = parameters["object.center_of_mass"], parameters["object.scale"]
        settings = parameters.body_settings

        def make() -> Body:
            try:
                with MeshProcess() as process:
                    # arrays of the file or message, then the cover, each in the other process
                    vertices, triangles = read_mesh(process)
                    middle, cover = np.array(center) if center else None, partial(cover_in, process)
                    body = Body.from_mesh(vertices, triangles, middle, scale, settings, cover)
            except (ValueError, OSError) as error:
                uri = str(parameters["object.mesh"])
                raise ObjectError("object.mesh", uri, f"cannot be read: {error}") from error
            # Takes seconds for many triangles, and start's answer is not to wait for it.
            object_solids(body)
            return body

        return (given_key, tuple(center), scale, settings), make

    def _open(self, uri: str) -> KeptMesh:
        """A mesh file by its name, its header found in order."""
        try:
            return mesh_of_file(self._files.find(uri, trusted=uri == self._operators))
        except (OSError, ValueError) as error:
            raise ObjectError("object.mesh", uri, f"cannot be read: {error}") from error

    def _listed_mesh(self, parameters: ParameterSet) -> KeptMesh:
        """The mesh that object.vertices and object.triangles list."""
        vertices, triangles = parameters["object.vertices"], parameters["object.triangles"]
        # compared by identity, as lists of parameters are replaced and never changed
        listed = self._listed
        if listed is not None and listed[0] is vertices and listed[1] is triangles:
            return listed[2]
        mesh = _as_it_is(mesh_from_lists(vertices, triangles))
        self._listed = vertices, triangles, mesh
        return mesh


def _as_it_is(mesh: tuple[Array, Triangles]) -> KeptMesh:
    """A mesh that is there already."""
    return digest_of(*mesh), lambda _: mesh


def _source_of(parameters: ParameterSet, names: Iterable[str], otherwise: Source) -> Source:
    """The source that the last non-empty one of these parameters belongs to."""
    source = otherwise
    for name in names:
        if name in _SOURCE_OF and parameters[name]:
            source = _SOURCE_OF[name]
    return source


def _read_words(body: Body) -> str:
    words = [f"{len(body.triangles)} triangles", *body.assumed, *body.warnings]
    return f"object read: {'; '.join(words)}"
