"""Figures in a page of the documentation, between two marks."""

from __future__ import annotations

from pathlib import Path

from placement_planner_ros.core.errors import ParameterError

BEGIN, END = "<!-- figures -->", "<!-- end of figures -->"


def require_marks(page: Path) -> None:
    """Refuse a page without its marks, before anything is measured.

    Raises:
        ParameterError: it has none.
    """
    text = page.read_text(encoding="utf-8") if page.exists() else ""
    if not 0 <= text.find(BEGIN) < text.find(END):
        raise ParameterError("page", str(page), f"must hold the lines {BEGIN} and {END}")


def between_marks(page: Path, figures: str) -> None:
    """Put figures in place of what is between the marks.

    Raises:
        ParameterError: see `require_marks`.
    """
    require_marks(page)
    before, rest = page.read_text(encoding="utf-8").split(BEGIN, 1)
    after = rest.split(END, 1)[1]
    page.write_text(f"{before}{BEGIN}\n\n{figures}\n{END}{after}", encoding="utf-8")
