"""Header and source of an export: the functions that a control unit calls, with their checks.

A state holds the parameters, the wheelset and the method's own state.
"""

from collections.abc import Iterable, Sequence
from itertools import chain
from types import FunctionType
from typing import Any, NamedTuple, cast

from ..core.estimator import KIND, Estimator, Sample
from ..core.methods import Method
from ..core.model import Quantity, Vehicle, Wheelset, quantities
from ..core.physics import wheelset_of
from ..wsp.controller import Observed
from .c_types import INT, Kind, Number, Scalar, Struct, ascii_text, c_name, declaration
from .expressions import INLINE
from .templates import render
from .translate import Translation, folded

# The fields of `Wheelset` that are vehicle parameters; the others follow from them.
WHEELSET_INPUTS = {
    "radius": "wheel_radius",
    "phi": "friction",
    "inertia": "wheelset_inertia",
    "mass": "axle_mass",
}
_STATUS = (
    ("OK", "the state is that of this sample"),
    ("BAD_POINTER", "an argument is NULL"),
    ("BAD_PARAMETER", "a parameter is NaN or out of its range"),
    ("BAD_WHEELSET", "the wheelset is out of its ranges, or not from wheelset_of"),
    ("BAD_INPUT", "an input is NaN or out of its range"),
    ("TOO_LONG", "the interval is too long for forward Euler (euler = 1)"),
    ("NOT_FINITE", "the result is no finite number"),
    ("NOT_BEGUN", "no init of this state was OK"),
)


class Code(NamedTuple):
    """The C of a method."""

    header: str
    source: str
    statuses: tuple[tuple[str, str], ...]
    read: frozenset[str]  # inputs that the method reads


class Interface:
    """Writes the C of one method.

    `p` are the defaults of the export, `vehicle` is R [m], friction, inertia [kg m²] and mass [kg]
    of the default wheelset.
    """

    def __init__(
        self, method: Method, p: Any, vehicle: tuple[float, ...], number: Number, version: str
    ) -> None:
        self.method, self.p, self.vehicle, self.version = method, p, vehicle, version
        self.name = f"adhesion_{method.name}"
        self.macro = self.name.upper()
        self.number = number
        self.c = Translation(self.name, number)
        self.real = self.c.types.real
        self.estimator = method if isinstance(method, Estimator) else None
        self.inputs = quantities(Sample if self.estimator else Observed)
        self.params = self.c.types.named(method.Params, "params", public=True)
        given_type, name = (Wheelset, "wheelset") if self.estimator else (Observed, "observed")
        self.given = self.c.types.named(given_type, name, public=True)
        self.now = self.c.types.named(method.State, "now", public=True)
        self.interval = quantities(Sample)["h"]
        longest_step = getattr(self.estimator, "longest_step", None)
        # whether a longer interval can be unstable
        self.limited = longest_step is not None and longest_step.__name__ == "longest_step"

    def code(self) -> Code:
        """Header and source."""
        calls = self._calls()
        read = frozenset(x for s, x in self.c.read if s == f"{self.name}_observed")
        tests = self._tests(read)
        absent = {"BAD_WHEELSET": not self.estimator, "TOO_LONG": not self.limited}
        statuses = tuple(x for x in _STATUS if not absent.get(x[0]))
        context = {
            "interface": self,
            "statuses": statuses,
            "title": ascii_text(f"{self.method.title}. {self.method.source}."),
            "calls": calls,
            "tests": tests,
            "inline": INLINE,
            "declaration": lambda *kinds: _fold(*declaration(*kinds)),
            "fold": _fold,
        }
        header, source = (render(f"method.{x}.jinja", **context) for x in ("h", "c"))
        return Code(header, source, statuses, read)

    def _calls(self) -> dict[str, str]:
        p: tuple[str, Kind] = ("*p", self.params)
        own: list[tuple[str, Kind]] = [("state->now", self.now), ("h", self.real)]
        sample: list[tuple[str, Kind]] = [("*o", self.given)]
        wheelset: list[tuple[str, Kind]] = []
        if self.estimator:
            wheelset, sample = [("*w", self.given)], [("K", self.real), ("y", self.real)]
            own.insert(0, ("state->w", self.given))
        step = self._call(self.method.step, [("state->p", self.params), *own, *sample])
        start = self._call(self.method.init, [p, *wheelset, *sample])
        calls = {"step": step, "start": start, "longest": ""}
        if self.limited:
            assert self.estimator
            calls["longest"] = self._call(self.estimator.longest_step, [p])
        if self.estimator:
            self._call(wheelset_of, [(c_name(x), self.real) for x in ("R", "phi", "I", "m")])
        return calls

    def _call(self, f: Any, arguments: Sequence[tuple[str, Kind]]) -> str:
        function = self.c.function(cast(FunctionType, f), tuple(kind for _, kind in arguments))
        used_values = [arguments[i] for i in function.used_arguments]
        texts = [f"&{x}" if isinstance(kind, Struct) else x for x, kind in used_values]
        return f"{function.name}({', '.join(texts).replace('&*', '')})"

    def signatures(self, real: str) -> dict[str, str]:
        """The public functions, by what they do; `real` is the floating-point type."""
        n = self.name
        state, p = f"{n}_state *state", f"const {n}_params *p"
        if self.estimator:
            parameters, sample = f"const {n}_wheelset *w, ", f"{real} K, {real} y"
        else:
            parameters, sample = "", f"const {n}_observed *o"
        vehicle = f"{real} radius, {real} phi, {real} inertia, {real} mass"
        return {
            "defaults": f"{n}_params {n}_defaults(void)",
            "wheelset": f"{n}_wheelset {n}_default_wheelset(void)",
            "wheelset_of": f"{n}_status {n}_wheelset_of({n}_wheelset *w, {vehicle})",
            "init": f"{n}_status {n}_init({state}, {p}, {parameters}{sample})",
            "step": f"{n}_status {n}_step({state}, {real} h, {sample})",
        }

    def state(self) -> Struct:
        """What the caller keeps for one axle."""
        members: list[tuple[str, Kind, str]] = [
            ("begun", INT, "whether init was OK"),
            ("p", self.params, "as given to init"),
        ]
        if self.estimator:
            members.append(("w", self.given, "as given to init"))
        if self.limited:
            members.append(("longest", self.real, "the longest stable interval [s]"))
        members.append(("now", self.now, f"the answer: {', '.join(self.answers())}"))
        fields = tuple((x, kind) for x, kind, _ in members)
        notes = tuple(text for *_, text in members)
        return Struct(f"{self.name}_state", fields, "State of one axle.", notes, True)

    def answers(self) -> list[str]:
        """The fields of the method's state that are its result."""
        if self.estimator:
            return ["sigma", *KIND.answer] if self.estimator.has_sigma else [*KIND.answer]
        return ["judged", "valve"]

    def literals(self, values: Iterable[float]) -> str:
        """Numbers in C, one after the other."""
        return ", ".join(map(self.number.literal, values))

    def _tests(self, read: frozenset[str]) -> dict[str, str]:
        """What holds for parameters, wheelset, the inputs that are read, interval and answers."""
        annotations = quantities(self.method.Params)
        tests = {
            "params": [
                x for n, q in annotations.items() for x in self._range_tests(f"p->{c_name(n)}", q)
            ]
        }
        if self.estimator:
            derived = [x for x, _ in self.given.fields if x not in WHEELSET_INPUTS]
            same = [f"(w->{x} == same.{x})" for x in derived]
            tests |= {"vehicle": self._vehicle_tests("")}
            tests |= {"wheelset": [*self._vehicle_tests("w->"), *same]}
            inputs = {n: n for n in ("K", "y")}
        else:
            inputs = {n: f"o->{n}" for n in self.inputs if n in read}
        ranges = [self._range_tests(x, self.inputs[n]) for n, x in inputs.items()]
        tests |= {"input": [*chain.from_iterable(ranges)]}
        tests |= {"interval": self._range_tests("h", self.interval)}
        kinds, finite = dict(self.now.fields), self.c.helper("finite")
        real_answers = [x for x in self.answers() if kinds[x] == self.real]
        tests |= {"finite": [f"{finite}(next.{x})" for x in real_answers]}
        return {name: " && ".join(x) for name, x in tests.items()}

    def _vehicle_tests(self, owner: str) -> list[str]:
        """The comparisons that hold for the inputs of a wheelset."""
        limits = quantities(Vehicle)
        tests = [self._range_tests(owner + x, limits[name]) for x, name in WHEELSET_INPUTS.items()]
        return list(chain.from_iterable(tests))

    def _range_tests(self, value: str, q: Quantity) -> list[str]:
        """The comparisons that hold in the range of a quantity, and for no NaN."""
        kinds = dict(self.given.fields) if value.startswith("o->") else {}
        if isinstance(kinds.get(value[3:]), Scalar) and kinds[value[3:]] != self.real:
            return [f"({value} >= {int(q.minimum)})", f"({value} <= {int(q.maximum)})"]
        lower, upper = (self.number.literal(float(x)) for x in (q.minimum, q.maximum))
        upper = self.number.largest if q.maximum == float("inf") else upper
        range_tests = [f"({value} >= {lower})", f"({value} <= {upper})"]
        if q.optional:
            return [f"({self.c.helper('nan')}({value}) || ({' && '.join(range_tests)}))"]
        return range_tests


def _fold(*lines: str) -> str:
    return "\n".join(folded([*lines]))
