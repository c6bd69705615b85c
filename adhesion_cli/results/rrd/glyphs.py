"""Texts as the native viewer can draw them: it ends at a letter that its two fonts do not have.

The fonts are Inter and JetBrains Mono. They have Latin, Greek and Cyrillic letters and some signs,
and no Chinese, Japanese, Korean or Arabic ones.
"""

import re
import unicodedata
from collections.abc import Iterable

from ...core.text import distinct

_LETTERS = "\n\t -~\u00a0-\u0148\u014a-\u017f\u0386-\u03ce\u0400-\u045f"
_SIGNS = "–—‘’“”…•‰⁴⁵⁶⁻₀₁₂←↑→↓∂∑−√∫≈≤≥■\u0302\u0304\u0307"
_MISSING = re.compile(f"[^{_LETTERS}{_SIGNS}]+")


def drawable(text: str) -> str:
    """The text with `…` for letters that the viewer does not have.

    >>> drawable("1轴速度（km/h）")
    '1…(km/h)'
    """
    if text.isascii():
        return text
    if not _MISSING.search(text):
        return text
    return _MISSING.sub("…", unicodedata.normalize("NFKC", text))


def drawable_names(names: Iterable[str]) -> list[str]:
    """Different names, each one drawable; what has no letter left is called `log`.

    >>> drawable_names(["制动1", "制动2", "制动.csv", "试验.csv"])
    ['…1', '…2', 'log.csv', 'log.csv (2)']
    """
    return distinct([re.sub(r"^…(?=\.|$)", "log", drawable(name)) for name in names])
