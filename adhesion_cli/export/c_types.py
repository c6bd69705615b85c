"""C types of the values that methods hold: numbers, and structs for NamedTuples and tuples."""

import ast
import inspect
import re
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import FunctionType
from typing import Any, NamedTuple, get_type_hints

from ..core.errors import UserError
from ..core.model import Quantity, quantities


@dataclass(frozen=True, slots=True)
class Scalar:
    """A number in C."""

    c: str


@dataclass(frozen=True, slots=True)
class Struct:
    """A NamedTuple or a tuple in C."""

    c: str
    fields: "tuple[tuple[str, Kind], ...]"
    text: str  # what it is
    notes: tuple[str, ...]  # of each field, with its unit
    public: bool  # declared in the header


Kind = Scalar | Struct
INT, BOOL = Scalar("int32_t"), Scalar("bool")


class Number(NamedTuple):
    """The floating-point type of an export."""

    c: str  # its name in C
    suffix: str  # of literals and of functions of the C library
    largest: str  # the largest finite value, of <float.h>

    def literal(self, x: float) -> str:
        """A number as C reads it back bit for bit."""
        if x != x:
            return "NAN"
        if x in (float("inf"), float("-inf")):
            return "INFINITY" if x > 0.0 else "(-INFINITY)"
        text = f"{float(x)!r}{self.suffix}"
        return text if x >= 0.0 and text[0] != "-" else f"({text})"


DOUBLE, SINGLE = Number("double", "", "DBL_MAX"), Number("float", "f", "FLT_MAX")


class Types:
    """The structs of an export in the order of declaration; their names begin with `prefix`."""

    def __init__(self, prefix: str) -> None:
        self.real = Scalar("real")
        self.structs: list[Struct] = []
        self._prefix = prefix
        self._structs: dict[Any, Struct] = {}

    def kind(self, hint: Any, public: bool = False) -> Kind:
        """The C type of a Python annotation; a UserError for one without a counterpart."""
        if hasattr(hint, "_fields"):
            return self.named(hint, public=public)
        if hint not in (float, int, bool):
            raise UserError(f"{hint}: no type that C has", "use float, int, bool or a NamedTuple")
        return {float: self.real, int: INT, bool: BOOL}[hint]

    def named(self, source: Any, name: str = "", public: bool = False) -> Struct:
        """The struct of a NamedTuple, after those inside of it; `public`: whether in the header."""
        if source in self._structs and (self._structs[source].public or not public):
            return self._structs[source]
        hints, notes = get_type_hints(source), _notes(source)
        fields = tuple((c_name(x), self.kind(hints[x], public)) for x in source._fields)
        name = name or source.__name__.lower()
        other_names = [s.c for s in self.structs if s != self._structs.get(source)]
        if f"{self._prefix}_{name}" in other_names:
            name = f"{stem(source)}_{name}"
        text = ascii_text((inspect.getdoc(source) or "").splitlines()[0])
        return self._add(source, Struct(f"{self._prefix}_{name}", fields, text, notes, public))

    def pair(self, kinds: tuple[Kind, ...]) -> Struct:
        """The struct of a tuple of these types."""
        if kinds in self._structs:
            return self._structs[kinds]
        fields = tuple((f"v{i}", kind) for i, kind in enumerate(kinds))
        suffix = "_".join(k.c.removeprefix(f"{self._prefix}_") for k in kinds)
        name, notes = f"{self._prefix}_{suffix}_pair", ("",) * len(kinds)
        return self._add(kinds, Struct(name, fields, "Two results.", notes, False))

    def _add(self, key: Any, struct: Struct) -> Struct:
        if key in self._structs:
            self.structs.remove(self._structs[key])
        self._structs[key] = struct
        self.structs.append(struct)
        return struct


def flat(root: Kind, path: str = "") -> list[tuple[str, Scalar]]:
    """Every number inside a value, with its path in C."""
    if isinstance(root, Scalar):
        return [(path, root)]
    return [x for name, kind in root.fields for x in flat(kind, f"{path}.{name}")]


def declaration(s: Struct, real: str = "real") -> list[str]:
    """The lines that declare a struct; `real` is the name of the floating-point type."""
    lines = [f"/* {s.text} */", "typedef struct {"]
    for (name, kind), note in zip(s.fields, s.notes, strict=True):
        c = real if kind.c == "real" else kind.c
        lines.append(f"    {c} {name};" + (f" /* {note} */" if note else ""))
    return [*lines, f"}} {s.c};", ""]


def stem(source: Any) -> str:
    """The file that defines a function or class, as the first part of a name in C."""
    return str(source.__module__).rpartition(".")[2].strip("_")


def c_name(name: str) -> str:
    """A Python name that C does not reserve."""
    name = name.strip("_")
    return f"{name}_" if name in _RESERVED else name


@cache
def tree_of(module_file: str) -> tuple[ast.Module, list[str]]:
    """A source file: its syntax tree and its lines."""
    with open(module_file, encoding="utf-8") as file:
        text = file.read()
    return ast.parse(text), text.splitlines()


def file_of(source: Any) -> str:
    """The source file of a function or a class."""
    if isinstance(source, FunctionType):
        return source.__code__.co_filename
    return inspect.getfile(source)


def definition(source: Callable[..., Any] | type) -> Any:
    """The syntax tree of a function or class at module level; a UserError where it is none."""
    for node in tree_of(file_of(source))[0].body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == source.__name__:
            return node
    raise UserError(f"{file_of(source)}: {source.__name__} is not defined at module level")


def comment_at(file: str, line: int) -> str:
    """The comment at the end of a line, without the remarks for linters."""
    text = tree_of(file)[1][line - 1].partition("#")[2].partition("#")[0].strip()
    return "" if re.match(r"noqa|fmt:|type:", text) else ascii_text(text)


def range_of(q: Quantity) -> str:
    """The values that C accepts, without their unit."""
    return q.range.removesuffix(f" {q.unit}") + (", or NaN" if q.optional else "")


def _notes(source: Any) -> tuple[str, ...]:
    """The comment beside each field, or what its `Quantity` says."""
    annotations = quantities(source)
    node = definition(source)
    lines = {ast.unparse(n.target): n.lineno for n in node.body if isinstance(n, ast.AnnAssign)}
    return tuple(
        ascii_text(f"{annotations[x].text} [{annotations[x].unit}]: {range_of(annotations[x])}")
        if x in annotations
        else comment_at(file_of(source), lines[x])
        for x in source._fields
    )


_RESERVED = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if "
    "inline int long register restrict return short signed sizeof static struct switch typedef "
    "union unsigned void volatile while bool true false real NULL".split()
)


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
