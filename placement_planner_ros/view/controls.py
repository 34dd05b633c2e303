"""Starting, stopping and confirming from the page; with `--control` only."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser

from placement_planner_ros.client import PlacementClient, PlacementError, Solution
from placement_planner_ros.view import words
from placement_planner_ros.view.panel import COMMANDS

PATIENCE = 5.0
"""Seconds for which a start is tried again that is refused for what passes by itself."""
_REGIONS = ("any", "largest")
_OBJECTIVES = ("maximize_clearance", "minimize_clearance", "weighted")
_NUMBERS = {
    "time_limit": "Time limit, s (0: none)",
    "collision_margin": "Collision margin, m",
    "edge_margin": "Edge margin, m",
}
_VOLUME, _OBJECTIVE, _RETREAT = "target_volume", "objective", "require_retreat"
_REGION = "support_region"


class Controls:
    """Buttons and fields, each of which asks the node; its answer stands below what was pressed.

    Args:
        client: of the planning node.
        run: number of its newest run.
        shown: the solution that is looked at; None where there is none.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        client: PlacementClient,
        run: Callable[[], int],
        shown: Callable[[], Solution | None],
    ) -> None:
        self._client, self._run, self._shown = client, run, shown
        self._known: dict[str, Any] = {}
        gui = server.gui
        acts = {"Start": self._start, "Stop": self._stop, "Confirm as placed": self._confirm}
        # what acts at once stands above, what changes the next start below
        buttons: Any = gui.add_button_group(
            "Planner",
            tuple(acts),
            hint="Confirm as placed: the placement that is shown has been carried out.",
            order=COMMANDS,
        )
        self._answer = gui.add_html("", order=COMMANDS)
        with gui.add_folder("Parameters of the next start", expand_by_default=False):
            self._fields: dict[str, Any] = {
                _VOLUME: gui.add_text("Target volume", "", hint="x y z, x y z: m"),
                _OBJECTIVE: gui.add_dropdown("Objective", _OBJECTIVES),
                _REGION: gui.add_dropdown("Place on region", _REGIONS),
                _RETREAT: gui.add_checkbox("Require a retreat", True),
            }
            for name, label in _NUMBERS.items():
                self._fields[name] = gui.add_number(label, 0.0, step=0.001)
        buttons.on_click(lambda event: self._do(acts[event.target.value]))

    def know(self, parameters: dict[str, Any]) -> None:
        """The node's parameters: fields whose value the node has changed show the new one.

        What somebody has typed into another field is left as it is.
        """
        # what the node says now, and what it said before
        before = self._known
        self._known = {name: parameters[name] for name in self._fields if name in parameters}
        for name, value in self._known.items():
            if name in before and before[name] == value:
                continue
            field = self._fields[name]
            if name == _OBJECTIVE:
                field.options = tuple(dict.fromkeys((*_OBJECTIVES, value)))
            in_words = name == _VOLUME
            field.value = " ".join(f"{number:g}" for number in value) if in_words else value

    def _do(self, act: Callable[[], str]) -> None:
        # the node may take a while
        self._answer.content = words.note_html("asking the node …")
        try:
            said = act()
        except PlacementError as error:
            said = str(error)
        except (TypeError, ValueError) as error:
            said = f"not sent: {error}"
        self._answer.content = words.note_html(said)

    def _start(self) -> str:
        changed = self._changed()
        run = self._client.start(changed, PATIENCE)
        # A browser that is busy may not have sent what was typed: then it is not named here.
        return f"run {run} has begun" + (f" with another {', '.join(changed)}" if changed else "")

    def _stop(self) -> str:
        if not self._run():
            return "no run was started"
        best = self._client.stop(self._run())
        return f"stopped; {best.words}"

    def _confirm(self) -> str:
        solution = self._shown()
        if solution is None:
            return "there is no placement to confirm"
        run = self._client.confirm_placed(solution)
        return f"solution {solution.number} of run {run} stands there now"

    def _changed(self) -> dict[str, Any]:
        """What the fields say that the node has not been told."""
        changed = {}
        # only what differs is sent, so that nothing else is set by a start
        for name, known in self._known.items():
            value = self._fields[name].value
            if name == _VOLUME:
                value = [float(number) for number in value.replace(",", " ").split()]
                known = [float(f"{number:g}") for number in known]
            if value != known:
                changed[name] = value
        return changed
