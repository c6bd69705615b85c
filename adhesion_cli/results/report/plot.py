"""The figures of an analysed log, for a notebook."""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

from bokeh.embed import file_html
from bokeh.layouts import column
from bokeh.resources import INLINE

from .plots import Figures
from .run import ReportRun

_FRAME = 60  # pixels around all figures


class Plot:
    """Figures below each other with one time axis; a notebook shows them.

    `axles` are drawn one by one; without any, speeds and µ of all together. `layout` is the Bokeh
    layout, as `bokeh.io.show` takes it.
    """

    def __init__(self, run: ReportRun, axles: Sequence[int] = ()) -> None:
        figures = Figures()
        figure_set = figures.of_run(run, axles)
        places = [place for axle in axles for place in figure_set.axles[axle]]
        figures_shown = figures.figures_of(places or figure_set.overview)
        self.layout: Any = column(figures_shown, sizing_mode="stretch_width")
        self._title = run.name
        self._height = _FRAME + sum(fig.height for fig in figures_shown)

    def html(self) -> str:
        """A page with the figures that needs no network and no other file."""
        return str(file_html(self.layout, INLINE, title=self._title))

    def write(self, place: Path | str) -> None:
        """Writes `html` to a file; its old content is lost.

        Raises:
            OSError: the file cannot be written.
        """
        Path(place).write_bytes(self.html().encode())

    def _repr_html_(self) -> str:
        style = f"width:100%;height:{self._height}px;border:0"
        return f'<iframe style="{style}" srcdoc="{escape(self.html())}"></iframe>'
