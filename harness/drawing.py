"""The style of all pictures: colours that the colour-blind can tell apart, grids, legends, figures as PNG."""

from __future__ import annotations

import io
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

DPI = 150
MAGENTA, CIRCLE_EDGE, CIRCLE_FACE = "#C2338F", "#D9AE00", "#FFF6C9"
TRUTH, GPS, ESTIMATE = "#111111", "#7A7A7A", "#7B3FB5"
ESTIMATES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#7B3FB5")
Style = dict[str, Any]
GRID: Style = {"color": "#E3E6EA", "linewidth": 0.8}
BESIDE: Style = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.03), "frameon": False, "borderaxespad": 0.0}
BELOW: Style = {"frameon": False, "columnspacing": 1.6, "handletextpad": 0.6}


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size [in] that needs no window; its layout makes room for what is drawn."""
    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def png_of(figure: Figure, dpi: float = DPI) -> bytes:
    """A figure as a PNG; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()
