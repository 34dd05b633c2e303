"""Brings together what is heard and what is shown, ten times a second."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
import pinocchio as pin
import viser

from placement_planner_ros.client import Solution
from placement_planner_ros.core.errors import PlacementPlannerError
from placement_planner_ros.core.types import Array
from placement_planner_ros.playback import CARRIED, Playback, pose_of
from placement_planner_ros.ros.inputs.point_cloud import points_from_message, some_of
from placement_planner_ros.view import charts, words
from placement_planner_ros.view.drawn_markers import drawn_points
from placement_planner_ros.view.listening import Listener
from placement_planner_ros.view.panel import Panel
from placement_planner_ros.view.record import Improvement, RunRecord
from placement_planner_ros.view.stage import FIELD_OF_VIEW, PageStage
from placement_planner_ros.view.world import Itself, World

IDLE, SEARCHING, PLAYING, UNWATCHED = 0.1, 0.2, 0.05, 0.25
"""Seconds between looks; beside a search, which needs the processor; between moments of a motion;
and between looks whether anybody has opened the page."""
_MOVED = 1e-4
"""rad or m by which a joint must have moved for the robot to be drawn anew, or V for the camera to
look from elsewhere: as it is published V differs in its last digits from the parameter."""
_ASIDE, _ELEVATION = np.deg2rad([30.0, 50.0])
"""rad: azimuth of the camera's first place from the robot's front, and its elevation."""
MOST_CELLS = 100_000
"""Cells of the obstacle set that are looked at."""


class Page:
    """The page. All that it does it does in `refresh`, in one thread.

    Attributes:
        record: the newest run.
        shown: what is looked at, the best but for a motion that plays; None where there is none.
    """

    def __init__(self, server: viser.ViserServer, listener: Listener, world: World) -> None:
        self._server, self._listener, self._world = server, listener, world
        self._stage = PageStage(server)
        self._panel = Panel(server, self._stage.show)
        self.record = RunRecord()
        self.shown: Improvement | None = None
        self._playback: Playback | None = None
        self._markers = drawn_points(None)
        self._obstacles = np.zeros((0, 3))
        self._drawn: dict[str, object] = {}
        self._faults: dict[str, str] = {}
        self._poses: Mapping[str, pin.SE3] = {}
        self._looked_at = time.monotonic()

    @property
    def solution(self) -> Solution | None:
        """The solution that is looked at."""
        return None if self.shown is None else self.shown.solution

    @property
    def _duration(self) -> float:
        """Of the motion that can be played, s; 0 while there is none."""
        return 0.0 if self._playback is None else self._playback.duration

    def refresh(self) -> float:
        """Show what is new; seconds until that is due again.

        While nobody has the page open, nothing is drawn.
        """
        now = time.monotonic()
        # what has come since the last look
        passed, self._looked_at = now - self._looked_at, now
        self._remember()
        self._hear()
        self._world.update(self._markers["object"])
        self._draw_robot_anew()
        if not self._server.get_clients():
            return UNWATCHED
        self._choose()
        # which solution is looked at, and how far its motion has been played
        self._panel.advance(passed, self._duration)
        self._move()
        # what stands around, and what is said of it
        self._look()
        self._draw_clouds()
        self._draw_scene()
        self._write()
        if self._panel.playing:
            return PLAYING
        return SEARCHING if self.record.active else IDLE

    # --- what is heard

    def _remember(self) -> None:
        heard = self._listener.hearing
        if heard.status is not None:
            self.record.take_status(heard.status, heard.solution, self._listener.positions)

    def _hear(self) -> None:
        markers, occupancy = self._listener.markers, self._listener.occupancy
        # messages are read once each: they are the same object until another comes
        if markers is not None and self._is_new("markers heard", Itself(markers)):
            with self._told("markers"):
                self._markers = drawn_points(markers)
        if occupancy is not None and self._is_new("cells heard", Itself(occupancy)):
            with self._told("occupancy"):
                self._obstacles = some_of(points_from_message(occupancy), MOST_CELLS)

    @contextmanager
    def _told(self, name: str) -> Iterator[None]:
        """Name what is wrong with what comes by that name, while something is."""
        self._faults.pop(name, None)
        try:
            yield
        except (ValueError, LookupError, PlacementPlannerError) as error:
            self._faults[name] = str(error)

    def _choose(self) -> None:
        """Look at the best solution."""
        chosen = self.record.best
        if chosen is not self.shown and self._panel.playing and chosen is not None:
            return  # what plays is played to its end
        known = (Itself(chosen), Itself(self._world.robot), self._listener.parameters.count)
        another, before = chosen is not self.shown, self._duration
        self.shown = chosen
        if not self._is_new("shown", known):
            return
        self._playback = None
        # its motion, where robot and tip are known
        if chosen is not None:
            with self._told("motion of the placement"):
                self._playback = self._playback_of(chosen)
        # what plays goes on where only parameters have come
        if another or self._duration != before:
            self._panel.rewind(self._duration)

    def _playback_of(self, improvement: Improvement) -> Playback | None:
        solution, tip = improvement.solution, self._world.tip(improvement.solution.arm)
        robot = self._world.robot
        if robot is None or not robot.has_link(tip) or not solution.trajectory.points:
            return None
        return Playback.of(
            solution,
            self._world.link_poses,
            tip,
            improvement.positions,
            self._world.opened(solution.arm),
        )

    # --- what is drawn

    def _draw_robot_anew(self) -> None:
        robot = self._world.robot
        if self._is_new("robot", Itself(robot)):
            self._stage.draw_robot({} if robot is None else robot.shapes)
            self._drawn.pop("posture", None)

    def _move(self) -> None:
        """Robot and object, as they are now or as they will be."""
        at, playback = self._panel.time, self._playback
        # at 0 the robot is shown as it is now, later as it will be
        moment = playback.at(at) if playback is not None and at > 0.0 else None
        positions = self._listener.positions if moment is None else moment.positions
        joints = self._world.robot.joints if self._world.robot is not None else ()
        # rounded, so that sensor noise moves nothing
        posture = tuple(round(positions.get(name, 0.0) / _MOVED) for name in joints)
        stage = "" if moment is None else moment.stage
        held = Itself(self._world.object), Itself(playback), self._confirmed
        if not self._is_new("posture", (posture, stage, held, self._listener.parameters.count)):
            return
        self._poses = self._world.link_poses(positions)
        self._stage.place_robot(self._poses)
        if moment is None:
            # in each hand that could hold it, or in the one that the motion is of
            holding = self._holding(self._poses)
        else:
            holding = [moment.T_world_object] if stage in CARRIED else []
        self._stage.draw_held(self._world.object, holding)

    def _holding(self, poses: Mapping[str, pin.SE3]) -> list[pin.SE3]:
        """T_world_object of the object in the hand: of each hand, where it is not known which."""
        if self._confirmed:
            return []
        if self._playback is not None and self._playback.tip in poses:
            return [poses[self._playback.tip] * self._playback.T_tip_object]
        return self._world.held(poses)

    @property
    def _confirmed(self) -> bool:
        """Whether this run's object stands where it was to be placed."""
        status = self.record.status
        return (
            status is not None and str(self.record.run) in status.values.get("placed", "").split()
        )

    def _draw_clouds(self) -> None:
        for topic, (frame, points) in self._listener.clouds.items():
            T = self._world.frame_pose(frame, self._poses)
            self._faults[topic] = f"nobody knows where its frame {frame!r} is" if T is None else ""
            # most clouds stand where they stood before; those of a moving sensor do not
            if T is not None and self._is_new(
                f"cloud {topic}", (Itself(points), T.homogeneous.tobytes())
            ):
                self._stage.draw_cloud(topic, points @ T.rotation.T + T.translation)

    def _draw_scene(self) -> None:
        shown, surface = self.shown, self._world.object
        if self._is_new("placement", (Itself(shown), Itself(surface))):
            # the object where it will stand, and the way there
            T = pose_of(shown.solution.pose.pose) if shown is not None else None
            self._stage.draw_placement(surface, T)
            path = self._playback.path() if self._playback is not None else None
            self._stage.draw_path(path)
        cell_size = float(self._world.parameter("cloud.cell_size", 0.01))
        # It is large and hidden at first, so that it is sent to nobody who does not ask for it.
        if "occupancy" in self._panel.visible and self._is_new("cells", Itself(self._obstacles)):
            self._stage.draw_occupancy(self._obstacles, cell_size)
        if self._is_new("standing", self._markers["standing"].tobytes()):
            self._stage.draw_standing(self._markers["standing"])
        leaning = self._markers["contacts"].reshape(-1, 2, 3), self._markers["wall"]
        if self._is_new("contacts", tuple(each.tobytes() for each in leaning)):
            self._stage.draw_contacts(*leaning)
        if self._is_new("volume", self._volume.tobytes()):
            self._stage.draw_volume(self._volume)
        # Each placement brings the regions along, mostly those that there were.
        if self._is_new("regions", self._markers["regions"].tobytes()):
            self._stage.draw_regions(self._markers["regions"])

    @property
    def _volume(self) -> Array:
        """V's boxes (k, 2, 3): of the run, and before there is one by the parameter."""
        if len(self._markers["target_volume"]):
            return self._markers["target_volume"]
        # six numbers a box; what is left over is no box
        numbers = np.array(self._world.parameter("target_volume", []), dtype=np.float64)
        return numbers[: len(numbers) // 6 * 6].reshape(-1, 2, 3)

    def _look(self) -> None:
        """Choose the camera's first place where robot and V are others: across V from the robot."""
        robot, volume = self._world.robot, self._volume
        if robot is None or len(volume) == 0 or not self._listener.positions:
            return
        # the first place stays until robot or V are others, so that nobody's view jumps
        rounded = tuple(np.round(volume.ravel() / _MOVED).astype(int).tolist())
        if not self._is_new("camera", (Itself(robot), rounded)):
            return
        # V and the object at the start shall be in view
        held = np.array([T.translation for T in self._holding(self._poses)]).reshape(-1, 3)
        shown = np.vstack([volume.reshape(-1, 3), held])
        middle = 0.5 * (shown.min(axis=0) + shown.max(axis=0))
        # 0.6 m at least, and 1.3 times as far as the ball around all just fits
        radius = 0.5 * float(np.linalg.norm(np.ptp(shown, axis=0)))
        distance = max(1.3 * radius / np.tan(FIELD_OF_VIEW / 2.0), 0.6)
        # across V from the robot, a little aside, from above
        root = self._poses.get(robot.root, pin.SE3.Identity()).translation
        azimuth = np.arctan2(*(middle - root)[1::-1]) + _ASIDE
        flat = np.cos(_ELEVATION) * np.array([np.cos(azimuth), np.sin(azimuth)])
        self._stage.look_from(middle + distance * np.array([*flat, np.sin(_ELEVATION)]), middle)

    # --- what is said

    def _write(self) -> None:
        record = self.record
        reason = "" if record.status is None else record.status.validity.reason
        if self.shown is not record.best:  # while its motion plays
            reason = "there is a better one"
        self._panel.curve.draw(record.curve, float(int(record.elapsed)))
        self._panel.write(
            heading=words.heading_html(record, self._listener.absent),
            placement=words.placement_html(
                self.solution, reason, self._world.parameter("objective", ""), self._confirmed
            ),
            bars=charts.rejection_bars(record.rejected, record.samples),
            note=words.note_html("; ".join(self._said_faults())),
            stage=self._stage_words(),
        )

    def _stage_words(self) -> str:
        if self._playback is None or self._panel.time <= 0.0:
            return ""
        return words.note_html(f"now: {self._playback.at(self._panel.time).stage}")

    def _said_faults(self) -> list[str]:
        faults = {**self._listener.faults, **self._world.faults, **self._faults}
        return [f"{name}: {said}" for name, said in faults.items() if said]

    def _is_new(self, name: str, key: object) -> bool:
        """Whether that is another than at the last look."""
        if name in self._drawn and self._drawn[name] == key:
            return False
        self._drawn[name] = key
        return True
