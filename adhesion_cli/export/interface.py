"""Header and source of an export: the functions that a control unit calls, with their checks.

A state holds the parameters, the wheelset and the method's own state.
"""

from collections.abc import Sequence
from itertools import chain
from types import FunctionType
from typing import Any, NamedTuple, cast

from ..core.estimator import KIND, Estimator, Sample
from ..core.methods import Method
from ..core.model import Quantity, Vehicle, Wheelset, quantities
from ..core.physics import wheelset_of
from ..wsp.controller import Observed
from .ascii_text import ascii_text
from .c_types import INT, Kind, Number, Scalar, Struct, c_name, declaration
from .expressions import Cost
from .translate import INLINE, Translation, folded

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
_BEGUN = 0x41444845  # what only init puts into a state: other memory hardly ever holds it


# A struct that a function returns then needs no memory.
_INLINE = f"""\
/* gcc and clang put each function into its callers, unless they optimize for size. */
#if defined(__GNUC__) && defined(__OPTIMIZE__) && !defined(__OPTIMIZE_SIZE__)
#define {INLINE} static inline __attribute__((always_inline))
#else
#define {INLINE} static inline
#endif
"""


class Code(NamedTuple):
    """The C of a method."""

    header: str
    source: str
    costs: dict[str, Cost]  # operations at most, by the function's name
    statuses: tuple[tuple[str, str], ...]
    read: frozenset[str]  # inputs that the method reads


class Interface:
    """Writes the C of one method.

    Args:
        method: estimator or controller.
        p: the parameters that are the defaults of the export.
        vehicle: R [m], friction, inertia [kg m²] and mass [kg] of the default wheelset.
        number: the floating-point type.
        version: of this program.
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
        self.limited = False  # whether a longer interval can be unstable

    def code(self) -> Code:
        """Header and source."""
        step, cost = self._step()
        start, initial_call = self._call(self.method.init, self._begins())
        longest = getattr(self.estimator, "longest_step", None)
        self.limited = longest is not None and longest.__name__ == "longest_step"
        limit, judged = [], Cost()
        if self.limited:
            call, judged = self._call(longest, [("*p", self.params)])
            limit = [f"state->longest = {call};"]
        wheelset_code, of_wheelset = "", Cost()
        if self.estimator:
            four = [(c_name(x), self.real) for x in ("R", "phi", "I", "m")]
            wheelset_code, of_wheelset = self._call(wheelset_of, four)
        read = frozenset(x for s, x in self.c.read if s == f"{self.name}_observed")
        checks = Cost({"compare": 2 * len(self.inputs) + 2})
        sections = [
            self._defaults(wheelset_code),
            self._wheelset(wheelset_code) if self.estimator else "",
            self._ranges(read),
            self._init(start, limit, bool(self.estimator)),
            self._step_text(step),
        ]
        input_count = len(WHEELSET_INPUTS) + len(self.given.fields) if self.estimator else 0
        ranges = Cost({"compare": 2 * len(self.params.fields) + input_count})
        costs = {"init": initial_call + judged + of_wheelset + checks + ranges}
        costs["step"] = cost + checks + Cost({"compare": 1 + self.limited})
        body = "\n".join(x for x in sections if x)
        statuses = tuple(x for x in _STATUS if self._returned(x[0]))
        return Code(self._header(statuses), self._source(body), costs, statuses, read)

    # --- what the functions compute ---------------------------------------------------------------

    def _call(self, f: Any, arguments: Sequence[tuple[str, Kind]]) -> tuple[str, Cost]:
        """A call of a translated function."""
        function = self.c.function(cast(FunctionType, f), tuple(kind for _, kind in arguments))
        passed = [arguments[i] for i in function.used_arguments]
        texts = [f"&{x}" if isinstance(kind, Struct) else x for x, kind in passed]
        return f"{function.name}({', '.join(texts).replace('&*', '')})", function.cost

    def _begins(self) -> list[tuple[str, Kind]]:
        p: tuple[str, Kind] = ("*p", self.params)
        if self.estimator:
            return [p, ("*w", self.given), ("K", self.real), ("y", self.real)]
        return [p, ("*o", self.given)]

    def _step(self) -> tuple[list[str], Cost]:
        """The lines that bring `next` one sample on."""
        p: tuple[str, Kind] = ("state->p", self.params)
        s: tuple[str, Kind] = ("state->now", self.now)
        h: tuple[str, Kind] = ("h", self.real)
        w: tuple[str, Kind] = ("state->w", self.given)
        sample: list[tuple[str, Kind]] = [("K", self.real), ("y", self.real)]
        arguments = [p, w, s, h, *sample] if self.estimator else [p, s, h, ("*o", self.given)]
        call, cost = self._call(self.method.step, arguments)
        return [f"{self.name}_now next = {call};"], cost

    # --- text -------------------------------------------------------------------------------------

    def _returned(self, status: str) -> bool:
        return {"BAD_WHEELSET": bool(self.estimator), "TOO_LONG": self.limited}.get(status, True)

    def _signatures(self, r: str = "real") -> dict[str, str]:
        """The public functions, by what they do; `r` is the floating-point type."""
        n = self.name
        state, p = f"{n}_state *state", f"const {n}_params *p"
        if self.estimator:
            parameters, sample = f"const {n}_wheelset *w, ", f"{r} K, {r} y"
        else:
            parameters, sample = "", f"const {n}_observed *o"
        wheelset = {
            "wheelset": f"{n}_wheelset {n}_default_wheelset(void)",
            "wheelset_of": f"{n}_status {n}_wheelset_of({n}_wheelset *w, {r} radius, {r} phi, "
            f"{r} inertia, {r} mass)",
        }
        return {
            "defaults": f"{n}_params {n}_defaults(void)",
            **(wheelset if self.estimator else {}),
            "init": f"{n}_status {n}_init({state}, {p}, {parameters}{sample})",
            "step": f"{n}_status {n}_step({state}, {r} h, {sample})",
        }

    def _header(self, statuses: tuple[tuple[str, str], ...]) -> str:
        n, public = self.name, [s for s in self.c.types.structs if s.public]
        title = ascii_text(f"{self.method.title}. {self.method.source}.")
        origin = f"   Made by adhesion {self.version}. Units are SI. "
        origin += "Ranges stand beside the values: README.md. */"
        lines = folded([f"/* {n}.h: {title}", origin])
        lines += [f"#ifndef {self.macro}_H", f"#define {self.macro}_H", "", "#include <stdint.h>"]
        real = f"{n}_real"
        lines += ["", f"typedef {self.number.c} {real};", ""]
        lines += ["/* What a function returns; if it is not OK, the estimate is as before. */"]
        lines += ["typedef enum {"]
        marks = [f"    {self.macro}_{x} = {i}" for i, (x, _) in enumerate(statuses)]
        last_mark = len(marks) - 1
        for i, (mark, (_, text)) in enumerate(zip(marks, statuses, strict=True)):
            lines.append(f"{mark}{',' if i < last_mark else ''} /* {text} */")
        lines += [f"}} {n}_status;", ""]
        for s in public:
            lines += folded(declaration(s, real))
        lines += ["#ifdef __cplusplus", 'extern "C" {', "#endif", ""]
        lines += [*folded(declaration(self.state(), real)), *self._prototypes()]
        lines += ["#ifdef __cplusplus", "}", "#endif", "", "#endif", ""]
        return "\n".join(lines)

    def state(self) -> Struct:
        """What the caller keeps for one axle."""
        members: list[tuple[str, Kind | None, str]] = [
            ("begun", INT, "whether init was OK"),
            ("p", self.params, "as given to init"),
        ]
        if self.estimator:
            members.append(("w", self.given, "as given to init"))
        if self.limited:
            members.append(("longest", self.real, "the longest stable interval [s]"))
        members.append(("now", self.now, f"the answer: {', '.join(self.answers())}"))
        fields = tuple((x, kind) for x, kind, _ in members if kind is not None)
        notes = tuple(text for *_, text in members)
        return Struct(f"{self.name}_state", fields, "State of one axle.", notes, True)

    def answers(self) -> list[str]:
        """The fields of the method's state that are its result."""
        if self.estimator:
            return ["sigma", *KIND.answer] if self.estimator.has_sigma else [*KIND.answer]
        return ["judged", "valve"]

    def _prototypes(self) -> list[str]:
        descriptions = {
            "defaults": "The parameters that the export was made with.",
            "wheelset": "The wheelset that it was made with.",
            "wheelset_of": "Of radius [m], pad friction phi [-], inertia [kg m^2], mass [kg].",
            "init": "The first sample, and the first after a gap: K [N], y [rad/s].",
            "step": "One sample later: h [s] since the last one, K [N], y [rad/s].",
        }
        if not self.estimator:
            descriptions["init"] = "The first tick."
            descriptions["step"] = "One tick later: h [s] since the last one."
        lines = []
        for key, signature in self._signatures(f"{self.name}_real").items():
            lines += [f"/* {descriptions[key]} */", *folded([f"{signature};"]), ""]
        return lines

    def _source(self, body: str) -> str:
        private = [s for s in self.c.types.structs if not s.public]
        lines = [f"/* {self.name}.c: made by adhesion {self.version} from the Python source. */"]
        lines += [f'#include "{self.name}.h"', "", "#include <float.h>", "#include <math.h>"]
        begun = f"#define BEGUN ({_BEGUN}) /* in a state: init was OK */"
        lines += ["#include <stdbool.h>", "#include <stddef.h>", "", begun]
        for macro, (value, comment) in self.c.constants.items():
            lines += [f"#define {macro} ({value})" + (f" /* {comment} */" if comment else "")]
        lines += ["", _INLINE, f"typedef {self.name}_real real;", ""]
        for s in private:
            lines += folded(declaration(s))
        return "\n".join([*lines, *self.c.functions, body])

    def _defaults(self, wheelset_code: str) -> str:
        values = ", ".join(self.number.literal(x) for x in self.p)
        lines = [f"    return ({self.name}_params){{{values}}};"]
        text = self._function("defaults", lines)
        if wheelset_code:
            name, _, _ = wheelset_code.partition("(")
            literals = ", ".join(self.number.literal(x) for x in self.vehicle)
            text += "\n" + self._function("wheelset", [f"    return {name}({literals});"])
        return text

    def _wheelset(self, wheelset_code: str) -> str:
        name, _, _ = wheelset_code.partition("(")
        assignment = f"*w = {name}(radius, phi, inertia, mass);"
        guards = [("w == NULL", "BAD_POINTER"), (_negated(self._vehicle_tests("")), "BAD_WHEELSET")]
        return self._function("wheelset_of", self._guarded(guards, [assignment]))

    def _vehicle_tests(self, owner: str) -> list[str]:
        """The comparisons that hold for the inputs of a wheelset."""
        limits = quantities(Vehicle)
        tests = [self._range_tests(owner + x, limits[name]) for x, name in WHEELSET_INPUTS.items()]
        return list(chain.from_iterable(tests))

    def _ranges(self, read: frozenset[str]) -> str:
        annotations = quantities(self.method.Params)
        tests = [x for n, q in annotations.items() for x in self._range_tests(f"p->{c_name(n)}", q)]
        text = self._test(f"params_ok(const {self.name}_params *p)", tests)
        if self.estimator:
            call = "physics_wheelset_of(w->radius, w->phi, w->inertia, w->mass)"
            declaration = f"const {self.name}_wheelset same = {call};"
            derived = [x for x, _ in self.given.fields if x not in WHEELSET_INPUTS]
            tests = [*self._vehicle_tests("w->"), *(f"(w->{x} == same.{x})" for x in derived)]
            text += self._test(f"wheelset_ok(const {self.name}_wheelset *w)", tests, declaration)
            tests = [x for n in ("K", "y") for x in self._range_tests(n, self.inputs[n])]
            return text + self._test("input_ok(real K, real y)", tests)
        names_read = [n for n in self.inputs if n in read]
        tests = [x for n in names_read for x in self._range_tests(f"o->{n}", self.inputs[n])]
        return text + self._test(f"input_ok(const {self.name}_observed *o)", tests)

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

    def _test(self, signature: str, tests: list[str], preamble: str = "") -> str:
        lines = [f"{INLINE} bool {signature}", "{", *([f"    {preamble}"] if preamble else [])]
        lines += folded([f"    return {' && '.join(tests)};"])
        return "\n".join([*lines, "}", "", ""])

    def _init(self, start: str, prepared: list[str], with_wheelset: bool) -> str:
        statements = ["state->p = *p;", *(["state->w = *w;"] if with_wheelset else []), *prepared]
        pointers = f"(state == NULL) || (p == NULL) || ({'w' if with_wheelset else 'o'} == NULL)"
        guards = [(pointers, "BAD_POINTER"), ("!params_ok(p)", "BAD_PARAMETER")]
        guards += [("!wheelset_ok(w)", "BAD_WHEELSET")] if with_wheelset else []
        guards += [(f"!input_ok({'K, y' if with_wheelset else 'o'})", "BAD_INPUT")]
        statements += [f"state->now = {start};", "state->begun = BEGUN;"]
        return self._function("init", self._guarded(guards, statements))

    def _step_text(self, step: list[str]) -> str:
        tests = self._range_tests("h", self.interval)
        sample = "K, y" if self.estimator else "o"
        pointers = "state == NULL" if self.estimator else "(state == NULL) || (o == NULL)"
        guards = [(pointers, "BAD_POINTER"), ("state->begun != BEGUN", "NOT_BEGUN")]
        guards += [(f"{_negated(tests)} || !input_ok({sample})", "BAD_INPUT")]
        if self.limited:
            guards += [("h > state->longest", "TOO_LONG")]
        kinds = dict(self.now.fields)
        finite = self.c.helper("finite")
        sound = [f"{finite}(next.{x})" for x in self.answers() if kinds[x] == self.real]
        statements = [*step, f"if ({' && '.join(sound)}) {{", "    state->now = next;", "} else {"]
        statements += [f"    status = {self.macro}_NOT_FINITE;", "}"]
        return self._function("step", self._guarded(guards, statements))

    def _guarded(self, guards: list[tuple[str, str]], statements: list[str]) -> list[str]:
        """Statements that run if no guard holds; else its status is returned."""
        lines = [f"    {self.name}_status status = {self.macro}_OK;"]
        word = "if"
        for test, status in guards:
            lines += folded([f"    {word} ({test}) {{"])
            lines += [f"        status = {self.macro}_{status};"]
            word = "} else if"
        body = folded(["        " + x for x in statements])
        return [*lines, "    } else {", *body, "    }", "    return status;"]

    def _function(self, key: str, lines: list[str]) -> str:
        return "\n".join([*folded([self._signatures()[key]]), "{", *lines, "}", ""])


def _negated(tests: list[str]) -> str:
    return f"!({' && '.join(tests)})"
