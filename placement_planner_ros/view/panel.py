"""The panel beside the scene: words, charts, and what plays a placement."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser

from placement_planner_ros.view.charts import ObjectiveCurve
from placement_planner_ros.view.stage import LAYERS

WIDTH = 385.0
"""Pixels, so that the words beside bars take one line each."""
HEADING, COMMANDS = -2.0, -1.0
"""Places in the column of what comes before all else."""
_HIDDEN = ("occupancy",)
"""Layers that are not shown at first."""


class Panel:
    """Its widgets, and what was done with them. Read from one thread.

    Attributes:
        playing: whether time goes on.
        time: seconds into the motion.
        curve: of the objective.
    """

    def __init__(self, server: viser.ViserServer, show: Callable[[str, bool], None]) -> None:
        gui = server.gui
        # one panel, wide enough for bars and numbers
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        gui.set_panel_label("placement_view")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        self.playing, self.time = False, 0.0
        self._toggled = False
        self._shown: dict[str, str] = {}
        # from above to below: the run, the placement, what plays it, charts, layers
        self._heading = gui.add_html("", order=HEADING)
        self._placement = gui.add_html("")
        self._play: Any = gui.add_button("Play", disabled=True, icon=viser.Icon.PLAYER_PLAY)
        self._slider: Any = gui.add_slider(
            "Time, s", 0.0, 1.0, 0.01, 0.0, disabled=True, hint="0: as it is now."
        )
        self._stage = gui.add_html("")
        self.curve = ObjectiveCurve(gui)
        self._bars = gui.add_html("")
        self._note = gui.add_html("")
        self._boxes: dict[str, Any] = {}
        # the layers' names tell their colours, so that this is the legend, too
        with gui.add_folder("Show"):
            for name, words in LAYERS.items():
                self._boxes[name] = gui.add_checkbox(words, name not in _HIDDEN)
                show(name, name not in _HIDDEN)
                self._boxes[name].on_update(
                    lambda event, name=name: show(name, bool(event.target.value))
                )
        self._play.on_click(self._toggle)

    def _toggle(self, _: object) -> None:
        self._toggled = True

    @property
    def visible(self) -> set[str]:
        """The layers that are shown."""
        return {name for name, box in self._boxes.items() if box.value}

    def rewind(self, duration: float) -> None:
        """Another motion: of so many seconds, 0 where there is none; a click that came meanwhile
        plays it."""
        self.playing, self.time = False, 0.0
        self._slider.value = 0.0
        self._slider.max = max(round(duration, 2), 0.01)
        self._slider.disabled = self._play.disabled = duration <= 0.0
        self._label_play()

    def advance(self, seconds: float, duration: float) -> None:
        """Let time go on, unless the slider was moved meanwhile."""
        # a click comes in another thread; it counts at the next look
        if self._toggled:
            self._toggled = False
            self.playing = not self.playing and duration > 0.0
            if self.playing and self.time >= duration:
                self.time = 0.0
                self._slider.value = 0.0
            self._label_play()
        # a slider that is elsewhere than it was put was moved by hand
        at = float(self._slider.value)
        if abs(at - self.time) > 0.011:
            self.time = at
        elif self.playing:
            self.time = min(self.time + seconds, duration)
            self._slider.value = round(self.time, 2)
        if self.playing and self.time >= duration:
            self.playing = False
            self._label_play()

    def _label_play(self) -> None:
        self._play.label = "Pause" if self.playing else "Play"
        icon = viser.Icon.PLAYER_PAUSE if self.playing else viser.Icon.PLAYER_PLAY
        self._play.icon = icon

    def write(self, **content: str) -> None:
        """HTML for heading, placement, stage, bars or note, sent where it is new."""
        for name, html in content.items():
            if self._shown.get(name) != html:
                self._shown[name] = html
                getattr(self, f"_{name}").content = html
