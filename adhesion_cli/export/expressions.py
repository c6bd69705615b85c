"""Python expressions in C: the same operations in the same order, so the same bits.

What C would compute in another way is refused. `x ** 2` is an example: Python calls `pow`, whose
last bit may differ from that of `x * x`, which compilers put in its place.
"""

import ast
import math
from types import FunctionType
from typing import Any, NamedTuple, NoReturn

from ..core.errors import UserError
from . import c_types
from .c_types import BOOL, INT, Kind, Scalar, Struct, c_name

# Functions of `math` that Python takes from the C library, which round as it does.
LIBRARY = frozenset(
    "fabs sqrt exp expm1 log log1p pow copysign sin cos tan tanh erf erfc floor ceil fmod atan "
    "atan2".split()
)
INLINE = "ADHESION_INLINE"  # the macro of a function that compilers put into its callers
_HELPERS = {
    "min": "{real} {name}({real} a, {real} b)\n{{\n    return (b < a) ? b : a;\n}}",
    "max": "{real} {name}({real} a, {real} b)\n{{\n    return (b > a) ? b : a;\n}}",
    "min_int": "int32_t {name}(int32_t a, int32_t b)\n{{\n    return (b < a) ? b : a;\n}}",
    "max_int": "int32_t {name}(int32_t a, int32_t b)\n{{\n    return (b > a) ? b : a;\n}}",
    "finite": "bool {name}({real} x)\n{{\n    return fabs{f}(x) <= {largest};\n}}",
    "nan": "bool {name}({real} x)\n{{\n    return x != x; /* only NaN is not itself */\n}}",
    "count": (
        "int32_t {name}({real} n, int32_t most)\n{{\n    int32_t count = 0; /* also for NaN */\n"
        "    if (n >= ({real})most) {{\n        count = most;\n    }} else if (n >= {one}) {{\n"
        "        count = (int32_t)n;\n    }} else {{\n        /* none */\n    }}\n"
        "    return count;\n}}"
    ),
}
_OPERATORS: dict[type, str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_COMPARED: dict[type, str] = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}


class Expr(NamedTuple):
    """An expression in C."""

    text: str
    kind: Kind
    simple: bool = False  # a name, a number or a call: needs no brackets
    address: str = ""  # of a struct in memory

    def bracketed(self) -> str:
        """As a part of a larger one."""
        return self.text if self.simple else f"({self.text})"


class Function(NamedTuple):
    """A function that C has now."""

    name: str
    used_arguments: tuple[int, ...]  # which arguments it takes
    kind: Kind


class Program:
    """Constants, structs and functions in their order; public names begin with `prefix`."""

    def __init__(self, prefix: str, number: c_types.Number) -> None:
        self.number = number
        self.types = c_types.Types(prefix)
        self.constants: dict[str, tuple[str, str]] = {}  # value and comment by name
        self.functions: list[str] = []
        self.read: set[tuple[str, str]] = set()  # struct and field
        self._helpers: set[str] = set()

    def function(self, f: FunctionType, kinds: tuple[Kind, ...]) -> Function:
        """The function with arguments of these types."""
        raise NotImplementedError

    def constant(self, f: FunctionType, name: str, value: float) -> str:
        """The macro of a number at module level."""
        macro = f"{c_types.stem(f)}_{name.strip('_')}".upper()
        text = f"(int32_t){value}" if isinstance(value, int) else self.number.literal(value)
        self.constants[macro] = (text, _comment(f, name))
        return macro

    def helper(self, name: str) -> str:
        """A function of the export's own, as `min` and `max` with Python's answer to NaN."""
        c_name = f"plain_{name}"
        if name not in self._helpers:
            self._helpers.add(name)
            names = {"real": self.types.real.c, "name": c_name, "f": self.number.suffix}
            numbers = {"one": self.number.literal(1.0), "largest": self.number.largest}
            text = _HELPERS[name].format(**names, **numbers)
            self.functions.insert(0, f"{INLINE} {text}\n")
        return c_name


class Expressions:
    """Translates the expressions of one function."""

    def __init__(self, program: Program, f: FunctionType) -> None:
        self.program = program
        self.f = f
        self.real = program.types.real
        self.local: dict[str, Kind] = {}
        self.pointers: set[str] = set()  # arguments that are structs
        self.ahead: list[str] = []  # statements that must come before this one
        self._temporaries = 0

    def __call__(self, node: ast.expr) -> Expr:
        """The expression in C; a UserError with the place of what is not in the subset."""
        translate: Any = getattr(self, f"_{type(node).__name__}", None)
        if translate is None:
            self.refuse(node, f"{type(node).__name__} is not in the subset that C gets")
        expression: Expr = translate(node)
        return expression

    def refuse(self, node: ast.AST, reason: str) -> NoReturn:
        """Raises the error that names the place."""
        line = getattr(node, "lineno", "?")
        hint = "use arithmetic, math, conditions and NamedTuples, as estimators/leso.py does"
        raise UserError(f"{c_types.file_of(self.f)}:{line}: {reason}", hint)

    def condition(self, node: ast.expr) -> Expr:
        """An expression that is true or false."""
        expression = self(node)
        if expression.kind != BOOL:
            self.refuse(node, "a condition must compare something")
        return expression

    # Each method below has the name of the node that it translates.

    def _Constant(self, node: ast.Constant) -> Expr:
        x = node.value
        if isinstance(x, bool):
            return Expr("true" if x else "false", BOOL, simple=True)
        if isinstance(x, int):
            return Expr(str(x), INT, simple=True)
        if isinstance(x, float):
            return Expr(self.program.number.literal(x), self.real, simple=True)
        self.refuse(node, f"{x!r} is no number")

    def _Name(self, node: ast.Name) -> Expr:
        if node.id in self.local:
            name, kind = c_name(node.id), self.local[node.id]
            if node.id in self.pointers:
                return Expr(f"(*{name})", kind, simple=True, address=name)
            return Expr(name, kind, simple=True, address=f"&{name}")
        value = self.f.__globals__.get(node.id)
        if isinstance(value, float | int):
            name = self.program.constant(self.f, node.id, value)
            return Expr(name, INT if isinstance(value, int) else self.real, simple=True)
        self.refuse(node, f"{node.id} is neither a variable nor a number")

    def _Attribute(self, node: ast.Attribute) -> Expr:
        if self._is_math(node):
            return Expr(
                self.program.number.literal(getattr(math, node.attr)), self.real, simple=True
            )
        owner = self(node.value)
        if not isinstance(owner.kind, Struct):
            self.refuse(node, f"{node.attr} of something without fields")
        name = c_name(node.attr)
        self.program.read.add((owner.kind.c, name))
        text = f"{owner.bracketed()}.{name}"
        if owner.address and not owner.address.startswith("&"):
            text = f"{owner.address}->{name}"
        return Expr(text, dict(owner.kind.fields)[name], True, f"&{text}" if owner.address else "")

    def _Subscript(self, node: ast.Subscript) -> Expr:
        sequence = self(node.value)
        i = node.slice.value if isinstance(node.slice, ast.Constant) else None
        if not isinstance(sequence.kind, Struct) or not isinstance(i, int):
            self.refuse(node, "an index must be a number, of a tuple")
        name, kind = sequence.kind.fields[i]
        return Expr(f"{sequence.bracketed()}.{name}", kind, True)

    def _UnaryOp(self, node: ast.UnaryOp) -> Expr:
        if isinstance(node.op, ast.Not):
            operand = self.condition(node.operand)
            return Expr(f"!{operand.bracketed()}", BOOL)
        operand = self(node.operand)
        if not isinstance(node.op, ast.USub) or operand.kind == BOOL:
            self.refuse(node, "only -x and `not` have one operand")
        return Expr(f"-{operand.bracketed()}", operand.kind)

    def _BinOp(self, node: ast.BinOp) -> Expr:
        if type(node.op) not in _OPERATORS:
            self.refuse(node, f"{type(node.op).__name__}: only + - * / (for x ** 2: x * x)")
        a, b = self(node.left), self(node.right)
        self._require_same_kind(node, a, b)
        sign = _OPERATORS[type(node.op)]
        if a.kind != self.real and sign == "/":
            self.refuse(node, "a division of whole numbers")
        return Expr(f"{a.bracketed()} {sign} {b.bracketed()}", a.kind)

    def _Compare(self, node: ast.Compare) -> Expr:
        operands = [self(x) for x in (node.left, *node.comparators)]
        texts = []
        for a, op, b in zip(operands, node.ops, operands[1:], strict=False):
            self._require_same_kind(node, a, b)
            if type(op) not in _COMPARED:
                self.refuse(node, f"comparison {type(op).__name__}")
            texts.append(f"{a.bracketed()} {_COMPARED[type(op)]} {b.bracketed()}")
        return Expr(" && ".join(f"({x})" for x in texts) if texts[1:] else texts[0], BOOL)

    def _BoolOp(self, node: ast.BoolOp) -> Expr:
        operands = [self.condition(x) for x in node.values]
        self._nothing_ahead(node)
        sign = " && " if isinstance(node.op, ast.And) else " || "
        return Expr(sign.join(x.bracketed() for x in operands), BOOL)

    def _IfExp(self, node: ast.IfExp) -> Expr:
        test, a, b = self.condition(node.test), self(node.body), self(node.orelse)
        self._require_same_kind(node, a, b)
        self._nothing_ahead(node)
        return Expr(f"{test.bracketed()} ? {a.bracketed()} : {b.bracketed()}", a.kind)

    def _Tuple(self, node: ast.Tuple) -> Expr:
        items = [self(x) for x in node.elts]
        return self._struct(self.program.types.pair(tuple(x.kind for x in items)), items)

    def _Call(self, node: ast.Call) -> Expr:
        if isinstance(node.func, ast.Attribute) and self._is_math(node.func):
            return self._library(node, node.func.attr)
        if not isinstance(node.func, ast.Name) or node.keywords:
            self.refuse(node, "only functions with a name, and arguments by place")
        name = node.func.id
        callee = self.f.__globals__.get(name)
        if isinstance(callee, FunctionType):
            arguments = [self(x) for x in node.args]
            target = self.program.function(callee, tuple(x.kind for x in arguments))
            used_values = (self._braced(arguments[i]) for i in target.used_arguments)
            return Expr(f"{target.name}({', '.join(used_values)})", target.kind, True)
        if hasattr(callee, "_fields"):
            kind = self.program.types.named(callee)
            arguments = [self(x) for x in node.args]
            if tuple(x.kind for x in arguments) != tuple(k for _, k in kind.fields):
                self.refuse(node, f"{name}: its fields have other types")
            return self._struct(kind, arguments)
        if callee is None and name in ("abs", "min", "max", "float"):
            return self._builtin(node, name)
        self.refuse(node, f"{name} is no function that C gets")

    def _braced(self, x: Expr) -> str:
        """An argument: a struct by its address. One that a function returns is kept for that."""
        if isinstance(x.kind, Scalar) or x.address:
            return x.address if isinstance(x.kind, Struct) else x.text
        self._temporaries += 1
        name = f"kept_{self._temporaries}"
        self.ahead.append(f"const {x.kind.c} {name} = {x.text};")
        return f"&{name}"

    def _nothing_ahead(self, node: ast.AST) -> None:
        if self.ahead:
            self.refuse(node, "a struct is made within a condition: give it a name before")

    def _library(self, node: ast.Call, name: str) -> Expr:
        operands = [self(x) for x in node.args]
        arguments = ", ".join(x.text for x in operands)
        if any(x.kind != self.real for x in operands):
            self.refuse(node, f"math.{name} of something that is no float")
        if name in ("isfinite", "isnan"):
            helper = self.program.helper(name.removeprefix("is"))
            return Expr(f"{helper}({arguments})", BOOL, True)
        if name not in LIBRARY:
            self.refuse(node, f"math.{name}: the C library has none with the same bits")
        return Expr(f"{name}{self.program.number.suffix}({arguments})", self.real, True)

    def _builtin(self, node: ast.Call, name: str) -> Expr:
        match name, node.args:
            case "float", [ast.Constant(value=str() as text)]:
                return Expr(self.program.number.literal(float(text)), self.real, simple=True)
        arguments = [self(x) for x in node.args]
        if name == "float":
            argument = arguments[0]  # math.ceil and math.floor are whole numbers in a float already
            text = argument.text
            if argument.kind != self.real:
                text = f"({self.real.c}){argument.bracketed()}"
            return Expr(text, self.real, argument.simple)
        if name == "abs":
            if arguments[0].kind != self.real:
                self.refuse(node, "abs of something that is no float")
            text = f"fabs{self.program.number.suffix}({arguments[0].text})"
            return Expr(text, self.real, True)
        extreme = arguments[0]
        for operand in arguments[1:]:
            self._require_same_kind(node, extreme, operand)
            helper = self.program.helper(f"{name}_int" if extreme.kind == INT else name)
            extreme = Expr(f"{helper}({extreme.text}, {operand.text})", extreme.kind, True)
        return extreme

    def _struct(self, kind: Struct, members: list[Expr]) -> Expr:
        text = f"({kind.c}){{{', '.join(x.text for x in members)}}}"
        return Expr(text, kind, True, f"&{text}")

    def _require_same_kind(self, node: ast.AST, a: Expr, b: Expr) -> None:
        if a.kind != b.kind or (isinstance(a.kind, Scalar) and a.kind == BOOL):
            self.refuse(node, "operands of two types: write 1.0 for a float, not 1")

    def _is_math(self, node: ast.Attribute) -> bool:
        return isinstance(node.value, ast.Name) and self.f.__globals__.get(node.value.id) is math


def _comment(f: FunctionType, name: str) -> str:
    """The comment beside a number at module level, where its file says one."""
    for node in c_types.tree_of(c_types.file_of(f))[0].body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        if any(isinstance(t, ast.Name) and t.id == name for t in targets):
            return c_types.comment_at(c_types.file_of(f), node.end_lineno or 0)
    return ""
