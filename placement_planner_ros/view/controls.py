"""Starting, stopping, confirming and setting parameters from the page; with `--control` only."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import viser
from rclpy.parameter_client import AsyncParameterClient

from placement_planner_ros.client import PlacementError, Solution
from placement_planner_ros.client.calls import parameter_message
from placement_planner_ros.client.session import Session
from placement_planner_ros.client.waiting import finish
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
_START, _STOP, _CONFIRM = "Start", "Stop", "Confirm as placed"
_VOLUME, _OBJECTIVE, _RETREAT = "target_volume", "objective", "require_retreat"
_REGION = "support_region"


class Controls:
    """Buttons and fields, each of which asks the node; its answer stands below what was pressed.

    Args:
        conversation: with the planning node.
        setting: of its parameters.
        run: number of its newest run.
        shown: the solution that is looked at; None where there is none.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        conversation: Session,
        setting: AsyncParameterClient,
        run: Callable[[], int],
        shown: Callable[[], Solution | None],
    ) -> None:
        self._talk, self._run, self._shown = conversation, run, shown
        self._setting = setting
        self._known: dict[str, Any] = {}
        gui = server.gui
        acts = {_START: self._start, _STOP: self._stop, _CONFIRM: self._confirm}
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
            keep = gui.add_button("Keep these for later starts, too")
            # Here, as the answer to the buttons at the top may be scrolled away.
            self._kept = gui.add_html("")
        buttons.on_click(lambda event: self._do(acts[event.target.value], self._answer))
        keep.on_click(lambda _: self._do(self._keep, self._kept))

    def know(self, parameters: dict[str, Any]) -> None:
        """The node's parameters: fields whose value the node has changed show the new one.

        What somebody has typed into another field is left as it is.
        """
        before = self._known
        self._known = {name: parameters[name] for name in self._fields if name in parameters}
        for name, value in self._known.items():
            if name in before and before[name] == value:
                continue
            field = self._fields[name]
            if name == _VOLUME:
                field.value = " ".join(f"{number:g}" for number in value)
            elif name == _OBJECTIVE:
                field.options = tuple(dict.fromkeys((*_OBJECTIVES, value)))
                field.value = value
            else:
                field.value = value

    def _do(self, act: Callable[[], str], answer: Any) -> None:
        self._answer.content = self._kept.content = ""
        answer.content = words.note_html("asking the node …")
        try:
            said = act()
        except PlacementError as error:
            said = words.refusal_words(error)
        except (TypeError, ValueError) as error:
            said = f"not sent: {error}"
        answer.content = words.note_html(said)

    def _start(self) -> str:
        changed = self._changed()
        run = finish(self._talk.start(changed, PATIENCE), self._talk.news)
        # A browser that is busy may not have sent what was typed: then it is not named here.
        return f"run {run} has begun" + (f" with another {', '.join(changed)}" if changed else "")

    def _stop(self) -> str:
        if not self._run():
            return "no run was started"
        best = finish(self._talk.stop(self._run()), self._talk.news)
        return f"stopped; {best.words}"

    def _confirm(self) -> str:
        solution = self._shown()
        if solution is None:
            return "there is no placement to confirm"
        run = finish(self._talk.confirm(solution, None), self._talk.news)
        return f"solution {solution.number} of run {run} stands there now"

    def _keep(self) -> str:
        changed = self._changed()
        if not changed:
            return "nothing was changed"
        if not self._setting.services_are_ready():
            return "no node is there"
        told = self._setting.set_parameters_atomically(
            [parameter_message(name, value) for name, value in changed.items()]
        )
        # In a thread of viser's, while another spins the node.
        told.add_done_callback(self._talk.news.tell)
        end = time.monotonic() + PATIENCE
        while not told.done() and time.monotonic() < end:
            self._talk.news.wait(self._talk.news.count, end)
        if not told.done() or told.result() is None:
            return "the node has not answered"
        result = told.result().result
        return f"set {', '.join(changed)}" if result.successful else str(result.reason)

    def _changed(self) -> dict[str, Any]:
        """What the fields say that the node has not been told."""
        changed = {}
        for name, known in self._known.items():
            value = self._fields[name].value
            if name == _VOLUME:
                value = _box_corners(value)
                known = [float(f"{number:g}") for number in known]
            if value != known:
                changed[name] = value
        return changed


def _box_corners(text: str) -> list[float]:
    """The numbers of a target volume, metres.

    Raises:
        ValueError: they are no boxes.
    """
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        numbers = [0.0]
    if len(numbers) % 6:  # none are none
        remedy = "give minimum x y z and maximum x y z in metres, six numbers for each box"
        raise ValueError(f"target volume {text!r}: {remedy}")
    return numbers
