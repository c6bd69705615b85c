"""What a process of ours does not import, although a library would."""

import sys


class _WithoutPandas:
    """Arrow loads pandas where it is installed, a fifth of a run; only Bokeh needs it here."""

    @staticmethod
    def find_spec(name: str, *_: object) -> None:
        """As a finder of modules does."""
        if name == "pandas" and "bokeh" not in sys.modules:
            raise ModuleNotFoundError("not loaded", name=name)


def refuse_pandas() -> None:
    """Lets this process import pandas only with Bokeh."""
    sys.meta_path.insert(0, _WithoutPandas)
