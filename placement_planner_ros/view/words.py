"""The words of the page about a run."""

from __future__ import annotations

from html import escape

from placement_planner_ros.client import Solution
from placement_planner_ros.ros.node_words import in_node_words
from placement_planner_ros.view.record import RunRecord


def heading_html(record: RunRecord, absent: str) -> str:
    """HTML: what the node is doing.

    Args:
        absent: why nothing is heard of the node; empty where it is there.
    """
    if absent:
        return _html_block(_bold_text(absent), "#b00020")
    status = record.status
    if status is None:
        return _html_block("the node is there; its status has not come yet", "#666")
    if record.run == 0:
        return _html_block(_bold_text("No run yet.") + " " + escape(status.message), "#666")
    # a run that ended with nothing has its own words
    empty = status.ended and record.best is None
    colour = {"searching": "#1668c8", "failed": "#b00020", "robot_moved": "#b00020"}.get(
        status.state, "#444"
    )
    badge = (
        f'<span style="background:{colour};color:#fff;border-radius:4px;padding:1px 7px">'
        f"{escape(status.state.replace('_', ' '))}</span>"
    )
    yet = "" if status.ended else " yet"
    found = f"{status.solutions} placements found" if status.solutions else f"none found{yet}"
    parts = [f"Run …{str(record.run)[-6:]} {badge}", f"{record.samples:,} samples tried, {found}"]
    if gap := status.values.get("gap"):
        parts.append(f"nothing is better by more than {float(gap):.3g}")
    if empty:
        parts.append(escape(status.message))
    return _html_block("<br>".join(parts), "#222")


def placement_html(solution: Solution | None, reason: str, objective: object, placed: bool) -> str:
    """HTML: where the object goes, and why there.

    Args:
        reason: why it cannot be carried out; empty where it can.
        objective: the parameter of that name.
        placed: whether this run's object stands already, by whichever of its solutions.
    """
    if solution is None:
        return _html_block("No placement so far.", "#666")
    p = solution.pose.pose.position
    where = f"x {p.x:.2f}, y {p.y:.2f}, z {p.z:.2f} m in {escape(solution.pose.header.frame_id)}"
    lines = [
        _bold_text(f"Placement {solution.number}"),
        f"{where}, by arm {escape(solution.arm)}, grasp {solution.grasp}",
        f"ξ = {_bold_text(f'{solution.objective:.3f}')} after {solution.search_time:.2f} s"
        + f": {escape(str(objective or 'your objective'))}",
    ]
    if solution.terms:
        terms = ", ".join(f"{escape(n)} {value:.3g}" for n, value in solution.terms.items())
        lines.append(f"terms: {terms}")
    if solution.leans_on:
        lines.append(f"it leans on {escape(solution.leans_on)}")
    if solution.unseen:
        lines.append(f"{solution.unseen:.1%} of the way leads where no camera looked")
    if placed:
        lines.append("This run's object has been put down already.")
    elif reason:
        lines.append(f'<span style="color:#b00020">Not to be carried out: {escape(reason)}</span>')
    else:
        lines.append('<span style="color:#14752f">It can be carried out.</span>')
    return _html_block("<br>".join(lines), "#222")


def note_html(text: str) -> str:
    """HTML: a remark in small grey letters, in lines as it is, by the names of the node."""
    inside = escape(in_node_words(text)).replace("\n", "<br>")
    return f'<div style="{_BOX};color:#666;font-size:11px">{inside}</div>' if text else ""


_BOX = "padding:2px 14px;font-size:12.5px;line-height:1.45;overflow-wrap:anywhere"


def _html_block(inside: str, colour: str) -> str:
    return f'<div style="{_BOX};color:{colour}">{inside}</div>'


def _bold_text(text: str) -> str:
    return f"<b>{escape(text)}</b>"
