"""Figures without a window, and their PNG."""

from __future__ import annotations

import io

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

DPI = 110


def new_figure(width: float, height: float, constrained: bool = True) -> Figure:
    """An empty figure, inches; its layout is constrained or left alone."""
    figure = Figure((width, height), DPI, layout="constrained" if constrained else None)
    FigureCanvasAgg(figure)
    return figure


def png(figure: Figure) -> bytes:
    """The figure as the bytes of a PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
