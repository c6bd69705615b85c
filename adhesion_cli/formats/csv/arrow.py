"""`pyarrow.compute`, loaded when a function of it is first used.

Loading makes some 300 functions, for which most logs have no use; it takes 60 ms.
"""

from typing import Any


def __getattr__(name: str) -> Any:
    import pyarrow.compute

    return getattr(pyarrow.compute, name)
