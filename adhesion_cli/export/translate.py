"""Functions of a method in C, with every function that they call.

Each becomes an inline function. It takes structs by their address, and changes none. One that is
called with arguments of other types is translated once for each.
"""

import ast
import inspect
import textwrap
from types import FunctionType

from .ascii_text import ascii_text
from .c_types import (
    BOOL,
    INT,
    Kind,
    Number,
    Struct,
    Types,
    c_name,
    comment_at,
    definition,
    file_of,
    stem,
    tree_of,
)
from .expressions import Cost, Expr, Expressions, Function

INLINE = "ADHESION_INLINE"  # the macro of a function that compilers put into its callers
_HELPERS = {
    "min": "{real} {name}({real} a, {real} b)\n{{\n    return (b < a) ? b : a;\n}}",
    "max": "{real} {name}({real} a, {real} b)\n{{\n    return (b > a) ? b : a;\n}}",
    "min_int": "int32_t {name}(int32_t a, int32_t b)\n{{\n    return (b < a) ? b : a;\n}}",
    "max_int": "int32_t {name}(int32_t a, int32_t b)\n{{\n    return (b > a) ? b : a;\n}}",
    "ceil": (
        "{real} {name}({real} x)\n{{\n    /* mostly 1, without a call */\n"
        "    return ((x > {zero}) && (x <= {one})) ? {one} : ceil{f}(x);\n}}"
    ),
    "finite": "bool {name}({real} x)\n{{\n    return fabs{f}(x) <= {largest};\n}}",
    "nan": "bool {name}({real} x)\n{{\n    return x != x; /* only NaN is not itself */\n}}",
    "count": (
        "int32_t {name}({real} n, int32_t most)\n{{\n    int32_t count = 0; /* also for NaN */\n"
        "    if (n >= ({real})most) {{\n        count = most;\n    }} else if (n >= {one}) {{\n"
        "        count = (int32_t)n;\n    }} else {{\n        /* none */\n    }}\n"
        "    return count;\n}}"
    ),
}


class Translation:
    """The C of one method: constants, structs and functions, in the order of declaration.

    Args:
        prefix: first part of public names, as `adhesion_td`.
        number: its floating-point type.
    """

    def __init__(self, prefix: str, number: Number) -> None:
        self.number = number
        self.types = Types(prefix, "real")
        self.constants: dict[str, tuple[str, str]] = {}  # value and comment by name
        self.functions: list[str] = []
        self.read: set[tuple[str, str]] = set()  # struct and field
        self._done: dict[tuple[FunctionType, tuple[Kind, ...]], Function] = {}
        self._under_way: list[FunctionType] = []
        self._helpers: set[str] = set()

    def function(self, f: FunctionType, kinds: tuple[Kind, ...]) -> Function:
        """The function with arguments of these types; translated at the first request.

        Raises:
            UserError: for what is not in the subset.
        """
        if (f, kinds) not in self._done:
            names = {x.name for x in self._done.values()}
            name = f"{stem(f)}_{f.__name__.strip('_')}"
            name = next(x for x in (name, *(f"{name}_{i}" for i in range(2, 99))) if x not in names)
            body = _Body(self, f, kinds)
            if f in self._under_way:
                body.expression.refuse(definition(f), f"{f.__name__} calls itself")
            self._under_way.append(f)
            text, made = body.translated(name)
            self._under_way.pop()
            self.functions.append(text)
            self._done[f, kinds] = made
        return self._done[f, kinds]

    def constant(self, f: FunctionType, name: str, value: float) -> str:
        """The macro of a number at module level."""
        macro = f"{stem(f)}_{name.strip('_')}".upper()
        text = f"(int32_t){value}" if isinstance(value, int) else self.literal(value)
        self.constants[macro] = (text, _comment(f, name))
        return macro

    def literal(self, x: float) -> str:
        """A number in the export's type."""
        return self.number.literal(x)

    def library(self, name: str) -> str:
        """A function of the C library in the export's type."""
        return name + self.number.suffix

    def helper(self, name: str) -> str:
        """A function of the export's own, as `min` and `max` with Python's answer to NaN."""
        called = f"plain_{name}"
        if name not in self._helpers:
            self._helpers.add(name)
            text = _HELPERS[name].format(
                real=self.types.real.c, name=called, f=self.number.suffix,
                zero=self.literal(0.0), one=self.literal(1.0), largest=self.number.largest,
            )  # fmt: skip
            self.functions.insert(0, f"{INLINE} {text}\n")
        return called

    def reads(self, of: Struct, field: str) -> None:
        """Notes that a field is read."""
        self.read.add((of.c, field))


class _Body:
    """One function."""

    def __init__(self, program: Translation, f: FunctionType, kinds: tuple[Kind, ...]) -> None:
        self.program = program
        self.f = f
        self.node: ast.FunctionDef = definition(f)
        self.expression = Expressions(program, f)
        self.arguments = [a.arg for a in self.node.args.args]
        if len(self.arguments) != len(kinds):
            self.expression.refuse(self.node, f"{f.__name__} is called with {len(kinds)} arguments")
        self.expression.local = dict(zip(self.arguments, kinds, strict=True))
        stored = {n.id for n in _names(self.node, ast.Store)}
        self.copied = stored & set(self.arguments)
        self.expression.pointers = {
            x for x, kind in zip(self.arguments, kinds, strict=True) if isinstance(kind, Struct)
        } - stored
        self.kinds = kinds
        self.results: set[Kind] = set()
        self.hoisted: dict[str, Kind] = {}
        self.temporary = 0

    def translated(self, name: str) -> tuple[str, Function]:
        """Its text, and how it is called."""
        loaded = {n.id for n in _names(self.node, ast.Load)}
        used = tuple(i for i, x in enumerate(self.arguments) if x in loaded)
        lines, cost, _ = self.block(self.node.body, 1, top=True)
        if len(self.results) != 1:
            self.expression.refuse(self.node, f"{self.f.__name__} returns several types, or none")
        (result,) = self.results
        taken, copies = [], []
        for i in used:
            x, kind = c_name(self.arguments[i]), self.kinds[i]
            star = "*" if isinstance(kind, Struct) else ""
            copied = self.arguments[i] in self.copied
            taken.append(f"{'const ' if star else ''}{kind.c} {star}{x}{'_in' if copied else ''}")
            copies += [f"    {kind.c} {x} = {star}{x}_in;"] if copied else []
        for x, of in self.hoisted.items():
            copies.append(f"    {of.c} {c_name(x)} = {self._zero(of)};")
        head = f"{INLINE} {result.c} {name}({', '.join(taken) or 'void'})"
        text = "\n".join([*_origin(self.f), *folded([head]), "{", *copies, *lines, "}", ""])
        return text, Function(name, used, result, cost)

    def block(
        self, body: list[ast.stmt], depth: int, top: bool = False
    ) -> tuple[list[str], Cost, bool]:
        """Lines and cost of statements, and whether they always return."""
        lines: list[str] = []
        cost = Cost()
        for i, node in enumerate(body):
            match node:
                case ast.Expr(value=ast.Constant()) | ast.Pass():
                    continue
                case ast.Return(value=ast.expr() as value):
                    made = self.expression(value)
                    self.results.add(made.kind)
                    lines += self._lines(f"return {made.text};", depth, node)
                    return lines, cost + made.cost, True
                case ast.If():
                    more, test, branches, ends = self._if(node, depth)
                    lines += more
                    if ends[0] and not ends[1]:
                        rest, after, returns = self.block(body[i + 1 :], depth, top)
                        total = cost + test + (branches[0] | (branches[1] + after))
                        return lines + rest, total, returns
                    cost += test + (branches[0] | branches[1])
                    if all(ends):
                        return lines, cost, True
                case ast.For():
                    more, spent = self._for(node, depth)
                    lines, cost = lines + more, cost + spent
                case ast.Assign(targets=[target], value=value):
                    more, spent = self._assign(node, target, value, depth, top)
                    lines, cost = lines + more, cost + spent
                case ast.AugAssign(target=ast.Name() as target, op=op, value=value):
                    old = ast.copy_location(ast.Name(target.id, ast.Load()), node)
                    total_of = ast.copy_location(ast.BinOp(old, op, value), node)
                    more, spent = self._assign(node, target, total_of, depth, top)
                    lines, cost = lines + more, cost + spent
                case _:
                    self.expression.refuse(node, f"{type(node).__name__} is not in the subset")
        return lines, cost, False

    def chained(self, node: ast.If) -> bool:
        """Whether an `if` is the `elif` of another."""
        return any(isinstance(n, ast.If) and n.orelse == [node] for n in ast.walk(self.node))

    def _if(self, node: ast.If, depth: int) -> tuple[list[str], Cost, list[Cost], list[bool]]:
        test = self.expression.condition(node.test)
        first, one, ends = self.block(node.body, depth + 1)
        lines = [*self._lines(f"if ({test.text}) {{", depth, node.test), *first]
        indent = "    " * depth
        costs, returns = [one, Cost()], [ends, False]
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
            more, other, branches, both = self._if(node.orelse[0], depth)
            if not more[0].lstrip().startswith("if "):
                self.expression.refuse(node.orelse[0], "a struct is made within an `elif`")
            costs[1], returns[1] = other + (branches[0] | branches[1]), all(both)
            more[0] = f"{indent}}} else {more[0].strip()}"
            return [*lines, *more], test.cost, costs, returns
        if node.orelse:
            second, costs[1], returns[1] = self.block(node.orelse, depth + 1)
            lines += [f"{indent}}} else {{", *second]
        elif self.chained(node):
            lines += [f"{indent}}} else {{", f"{indent}    /* as before */"]
        return [*lines, f"{indent}}}"], test.cost, costs, returns

    def _for(self, node: ast.For, depth: int) -> tuple[list[str], Cost]:
        match node:
            case ast.For(
                target=ast.Name(id=name),
                iter=ast.Call(func=ast.Name(id="range"), args=[count], keywords=[]), orelse=[],
            ):  # fmt: skip
                pass
            case _:
                self.expression.refuse(node, "only `for i in range(n)`")
        bound, most = self._bound(count)
        self.expression.local[name] = INT
        lines, cost, _ = self.block(node.body, depth + 1)
        i = c_name(name)
        head = f"for (int32_t {i} = 0; {i} < {bound.text}; {i}++) {{"
        spent = Cost({k: n * most for k, n in (cost + Cost({"compare": 1})).items()})
        return [
            *self._lines(head, depth, node.iter),
            *lines,
            "    " * depth + "}",
        ], bound.cost + spent

    def _bound(self, count: ast.expr) -> tuple[Expr, int]:
        """The number of rounds, and the largest that it can be."""
        if isinstance(count, ast.Constant) and isinstance(count.value, int):
            return self.expression(count), count.value
        match count:
            case ast.Call(func=ast.Name(id="int"), args=[number]):
                made = self.expression(number)
            case _:
                self.expression.refuse(count, "only range(8) or range(int(x))")
        most = self.f.__globals__.get("SUBSTEPS")
        if not isinstance(most, float):
            self.expression.refuse(count, "the file states no SUBSTEPS, the bound of this loop")
        text = f"{self.program.helper('count')}({made.text}, {int(most)})"
        return Expr(text, INT, made.cost + Cost({"compare": 2}), True), int(most)

    def _assign(
        self, node: ast.stmt, target: ast.expr, value: ast.expr, depth: int, top: bool
    ) -> tuple[list[str], Cost]:
        match target, value:
            case ast.Name(), _:
                made = self.expression(value)
                return self._lines(self._put(target.id, made, top), depth, node), made.cost
            case ast.Tuple(elts=targets), ast.Tuple(elts=values) if len(targets) == len(values):
                return self._several(node, targets, values, depth, top)
            case ast.Tuple(elts=targets), ast.Call():
                made = self.expression(value)
                self.temporary += 1
                both, indent = f"both_{self.temporary}", "    " * depth
                lines = self._lines(f"const {made.kind.c} {both} = {made.text};", depth, node)
                assert isinstance(made.kind, Struct)
                for x, (field, kind) in zip(targets, made.kind.fields, strict=True):
                    part = Expr(f"{both}.{field}", kind)
                    lines.append(indent + self._put(self._named(x), part, top))
                return lines, made.cost
        self.expression.refuse(node, "only names on the left")

    def _several(
        self, node: ast.stmt, targets: list[ast.expr], values: list[ast.expr], depth: int, top: bool
    ) -> tuple[list[str], Cost]:
        """`a, b = x, y`: through temporary names where a later value needs an earlier name."""
        names = [self._named(x) for x in targets]
        made = [self.expression(x) for x in values]
        needed = [{n.id for n in ast.walk(x) if isinstance(n, ast.Name)} for x in values]
        crossed = any(set(names[:i]) & used for i, used in enumerate(needed))
        lines, new = self._ahead(depth), []
        for x in made:
            self.temporary += 1
            new.append(Expr(f"new_{self.temporary}", x.kind) if crossed else x)
            if crossed:
                lines.append("    " * depth + f"const {x.kind.c} {new[-1].text} = {x.text};")
        for name, put in zip(names, new, strict=True):
            lines.append("    " * depth + self._put(name, put, top))
        lines[-1:] = self._lines(lines[-1].strip(), depth, node)
        return folded(lines), sum((x.cost for x in made), Cost())

    def _put(self, name: str, made: Expr, top: bool) -> str:
        """The statement that gives a variable its value; declares it where it is new."""
        known = self.expression.local.get(name)
        if known not in (None, made.kind):
            self.expression.refuse(self.node, f"{name} changes its type")
        self.expression.local[name] = made.kind
        if known is None and top:
            return f"{made.kind.c} {c_name(name)} = {made.text};"
        if known is None:
            self.hoisted[name] = made.kind
        return f"{c_name(name)} = {made.text};"

    def _named(self, x: ast.expr) -> str:
        if not isinstance(x, ast.Name):
            self.expression.refuse(x, "only names on the left")
        return x.id

    def _zero(self, kind: Kind) -> str:
        if isinstance(kind, Struct):
            zeros = [self._zero(k) for _, k in kind.fields]
            return f"{{{', '.join(zeros)}}}"
        zeros_of = {self.program.types.real: self.program.literal(0.0), BOOL: "false"}
        return zeros_of.get(kind, "0")

    def _ahead(self, depth: int) -> list[str]:
        """The statements that an expression needs before its own."""
        lines = folded(["    " * depth + x for x in self.expression.ahead])
        self.expression.ahead.clear()
        return lines

    def _lines(self, text: str, depth: int, node: ast.AST) -> list[str]:
        """A statement, with the comment of its Python line where that names an equation."""
        remark = comment_at(file_of(self.f), node.end_lineno or 0)  # type: ignore[attr-defined]
        text = "    " * depth + text
        return self._ahead(depth) + folded([text + (f" /* {remark} */" if remark else "")])


def folded(lines: list[str]) -> list[str]:
    """Lines of at most 100 characters, broken at a comma, && or ||, else at a space."""
    found: list[str] = []
    for line in lines:
        deeper = " " * (len(line) - len(line.lstrip()) + 4)
        while len(line) > 100:
            low = len(deeper) + 40
            at = max(line.rfind(sign, low, 100) + len(sign) - 1 for sign in (", ", " && ", " || "))
            if at < low:
                at = line.rfind(" ", len(deeper), 101)
            if at < 0:
                break
            found.append(line[:at].rstrip())
            line = deeper + line[at:].lstrip()
        found.append(line)
    return found


def _names(node: ast.AST, context: type) -> list[ast.Name]:
    """The names that are read (`ast.Load`) or given a value (`ast.Store`)."""
    names = [n for n in ast.walk(node) if isinstance(n, ast.Name)]
    return [n for n in names if isinstance(n.ctx, context)]


def _origin(f: FunctionType) -> list[str]:
    """The comment above a function: where it is from, and what it does."""
    text = (inspect.getdoc(f) or "").splitlines() or [""]
    place = file_of(f).rpartition("adhesion_cli/")[2]
    comment = f"/* {f.__name__} of {place}: {ascii_text(text[0])} */"
    return textwrap.wrap(comment, 100, subsequent_indent="   ")


def _comment(f: FunctionType, name: str) -> str:
    """The comment beside a number at module level, where its file says one."""
    for node in tree_of(file_of(f))[0].body:
        if isinstance(node, ast.Assign) and any(
            isinstance(t, ast.Name) and t.id == name for t in node.targets
        ):
            return comment_at(file_of(f), node.end_lineno or 0)
    return ""
