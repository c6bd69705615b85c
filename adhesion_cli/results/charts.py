"""Line charts as SVG, drawn by matplotlib."""

import io
import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.model import Floats
from . import verified

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_Options = dict[str, Any]  # of matplotlib
_LEGEND_COLUMNS, _LEGEND_ROW, _TITLE_PAD = 3, 13.0, 5.0  # entries of a row; heights [points]
_PANEL, _COLUMNS = (4.4, 3.3), 3  # width and height [inch]; charts in a row
_STYLE: _Options = {
    "svg.hashsalt": "adhesion",  # names inside the file are the same at each run
    "svg.fonttype": "none",  # text stays text
    "text.parse_math": False,  # a "$" in the name of a log is a "$"
    "path.simplify_threshold": 0.5,  # points of a curve that is as good without them [pixel]
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "figure.dpi": 120,
}


@dataclass(frozen=True, slots=True)
class Line:
    """One curve; NaN, and what a logarithmic axis cannot show, leave a hole."""

    name: str  # in the legend; "" for none
    x: Floats
    y: Floats
    colour: str
    dashed: bool = False


@dataclass(frozen=True, slots=True)
class Panel:
    """One chart."""

    title: str
    x_label: str
    y_label: str
    lines: Sequence[Line]
    log_x: bool = False
    log_y: bool = False
    y_range: tuple[float, float] | None = None  # None: all data


def write(path: Path, title: str, panels: Sequence[Panel]) -> None:
    """Write the panels row by row under a title; the same panels give the same bytes.

    Raises as `verified.verified`.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # where it keeps fonts is no result
    from matplotlib import style
    from matplotlib.figure import Figure

    columns = min(_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    image = io.BytesIO()
    with style.context(["default", _STYLE]), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a letter that the font lacks is shown as a box
        figure = Figure((columns * _PANEL[0], rows * _PANEL[1]), layout="constrained")
        figure.suptitle(title, fontweight="bold")
        for i, panel in enumerate(panels, 1):
            _draw(figure.add_subplot(rows, columns, i), panel)
        figure.savefig(image, format="svg", metadata={"Date": None})
    verified.write(path, image.getvalue())


def _draw(axes: "Axes", panel: Panel) -> None:
    for line in panel.lines:
        # Matplotlib leaves names that begin with "_" out of the legend.
        style: _Options = {"color": line.colour, "label": line.name or "_"}
        axes.plot(line.x, line.y, "--" if line.dashed else "-", linewidth=1.1, **style)
    axes.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
    for is_log, set_scale, axis in (
        (panel.log_x, axes.set_xscale, axes.xaxis),
        (panel.log_y, axes.set_yscale, axes.yaxis),
    ):
        if is_log:
            set_scale("log", nonpositive="mask")
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter("")
    axes.set_ylim(panel.y_range)
    if named := len(axes.get_legend_handles_labels()[0]):
        # Between title and chart: below, it would lie on the names along the axis.
        axes.set_title(panel.title, pad=_TITLE_PAD + _LEGEND_ROW * -(-named // _LEGEND_COLUMNS))
        place: _Options = {"loc": "lower center", "bbox_to_anchor": (0.5, 0.99)}
        axes.legend(ncols=_LEGEND_COLUMNS, markerscale=1.6, borderaxespad=0.0, **place)
