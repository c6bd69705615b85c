"""Text in ASCII: the compilers of many control units read nothing else, not even in comments."""

import unicodedata

_GREEK = (
    "alpha beta gamma delta eps zeta eta theta iota kappa lambda mu nu xi omicron pi rho sigma tau "
    "upsilon phi chi psi omega"
)
_SIGNS = {
    **{"²": "^2", "³": "^3", "₀": "0", "₁": "1", "₂": "2", "·": " ", "−": "-", "–": "-"},
    **{"≤": "<=", "≥": ">=", "×": "x", "→": "->", "←": "<-", "±": "+-", "…": "...", "’": "'"},
    **{"∫": "integral ", "∑": "sum ", "Σ": "sum ", "√": "sqrt ", "°": "deg", "∈": "in"},
    **{"Δ": "delta", "ϑ": "theta", "Ω": "Omega", "Φ": "Phi", "\u0302": "_est", "\u0307": "_dot"},
}
_NAMES = dict(zip("αβγδεζηθικλμνξοπρστυφχψω", _GREEK.split(), strict=True)) | _SIGNS


def ascii_text(text: str) -> str:
    """The same in ASCII: `ω̂ [rad/s²]` is `omega_est [rad/s^2]`.

    >>> ascii_text("q h [rad²/s²], φK ≥ 0")
    'q h [rad^2/s^2], phiK >= 0'
    """
    normal = unicodedata.normalize("NFD", text)  # accents are characters of their own there
    letters = [x for x in normal if x in _NAMES or unicodedata.category(x) != "Mn"]
    ascii_letters = "".join(x if x.isascii() else _NAMES.get(x, "?") for x in letters)
    return ascii_letters.replace("*/", "* /").replace("/*", "/ *")
