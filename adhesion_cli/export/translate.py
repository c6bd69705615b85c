"""Functions of a method in C, with every function that they call.

Each becomes an inline function. It takes structs by their address, and changes none. One that is
called with arguments of other types is translated once for each.
"""

import ast
import inspect
import textwrap
from types import FunctionType

from . import c_types
from .c_types import BOOL, INT, Kind, Struct, c_name, comment_at, definition, file_of
from .expressions import INLINE, Expr, Expressions, Function, Program


class Translation(Program):
    """The C of one method: constants, structs and functions, in the order of declaration."""

    def __init__(self, prefix: str, number: c_types.Number) -> None:
        super().__init__(prefix, number)
        self._translated: dict[tuple[FunctionType, tuple[Kind, ...]], Function] = {}
        self._under_way: list[FunctionType] = []

    def function(self, f: FunctionType, kinds: tuple[Kind, ...]) -> Function:
        """The function with arguments of these types, translated once; raises as `Expressions`."""
        if (f, kinds) not in self._translated:
            names = {x.name for x in self._translated.values()}
            name = f"{c_types.stem(f)}_{f.__name__.strip('_')}"
            name = next(x for x in (name, *(f"{name}_{i}" for i in range(2, 99))) if x not in names)
            body = _Body(self, f, kinds)
            if f in self._under_way:
                body.expression.refuse(definition(f), f"{f.__name__} calls itself")
            self._under_way.append(f)
            text, entry = body.translated(name)
            self._under_way.pop()
            self.functions.append(text)
            self._translated[f, kinds] = entry
        return self._translated[f, kinds]


class _Body:
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
        local = self.expression.local
        self.expression.pointers = {x for x in local if isinstance(local[x], Struct)} - stored
        self.kinds = kinds
        self.results: set[Kind] = set()
        self.hoisted: dict[str, Kind] = {}
        self.temporary = 0

    def translated(self, name: str) -> tuple[str, Function]:
        """Its text, and how it is called."""
        loaded = {n.id for n in _names(self.node, ast.Load)}
        used_arguments = tuple(i for i, x in enumerate(self.arguments) if x in loaded)
        lines, _ = self.block(self.node.body, 1, top=True)
        if len(self.results) != 1:
            self.expression.refuse(self.node, f"{self.f.__name__} returns several types, or none")
        (result,) = self.results
        parameters, copies = [], []
        for i in used_arguments:
            x, kind = c_name(self.arguments[i]), self.kinds[i]
            star = "*" if isinstance(kind, Struct) else ""
            copied = self.arguments[i] in self.copied
            constant, suffix = "const " if star else "", "_in" if copied else ""
            parameters.append(f"{constant}{kind.c} {star}{x}{suffix}")
            copies += [f"    {kind.c} {x} = {star}{x}_in;"] if copied else []
        for x, struct in self.hoisted.items():
            copies.append(f"    {struct.c} {c_name(x)} = {self._zero(struct)};")
        head = f"{INLINE} {result.c} {name}({', '.join(parameters) or 'void'})"
        text = "\n".join([*_origin(self.f), *folded([head]), "{", *copies, *lines, "}", ""])
        return text, Function(name, used_arguments, result)

    def block(self, body: list[ast.stmt], depth: int, top: bool = False) -> tuple[list[str], bool]:
        """The lines of statements, and whether they always return."""
        lines: list[str] = []
        for node in body:
            match node:
                case ast.Expr(value=ast.Constant()) | ast.Pass():
                    continue
                case ast.Return(value=ast.expr() as value):
                    expression = self.expression(value)
                    self.results.add(expression.kind)
                    return [*lines, *self._lines(f"return {expression.text};", depth, node)], True
                case ast.If():
                    branch_lines, returns = self._if(node, depth)
                    lines += branch_lines
                    if returns:
                        return lines, True
                case ast.For():
                    lines += self._for(node, depth)
                case ast.Assign(targets=[target], value=value):
                    lines += self._assign(node, target, value, depth, top)
                case ast.AugAssign(target=ast.Name() as target, op=op, value=value):
                    previous = ast.copy_location(ast.Name(target.id, ast.Load()), node)
                    total_of = ast.copy_location(ast.BinOp(previous, op, value), node)
                    lines += self._assign(node, target, total_of, depth, top)
                case _:
                    self.expression.refuse(node, f"{type(node).__name__} is not in the subset")
        return lines, False

    def _if(self, node: ast.If, depth: int) -> tuple[list[str], bool]:
        """The lines of a condition, and whether every branch returns."""
        test = self.expression.condition(node.test)
        then_lines, then_returns = self.block(node.body, depth + 1)
        lines = [*self._lines(f"if ({test.text}) {{", depth, node.test), *then_lines]
        indent, returns = "    " * depth, False
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
            else_lines, returns = self._if(node.orelse[0], depth)
            if not else_lines[0].lstrip().startswith("if "):
                self.expression.refuse(node.orelse[0], "a struct is made within an `elif`")
            else_lines[0] = f"{indent}}} else {else_lines[0].strip()}"
            return [*lines, *else_lines], then_returns and returns
        if node.orelse:
            second, returns = self.block(node.orelse, depth + 1)
            lines += [f"{indent}}} else {{", *second]
        elif any(isinstance(n, ast.If) and n.orelse == [node] for n in ast.walk(self.node)):
            lines += [f"{indent}}} else {{", f"{indent}    /* as before */"]
        return [*lines, f"{indent}}}"], then_returns and returns

    def _for(self, node: ast.For, depth: int) -> list[str]:
        match node:
            case ast.For(
                target=ast.Name(id=name),
                iter=ast.Call(func=ast.Name(id="range"), args=[count], keywords=[]),
                orelse=[],
            ):
                pass
            case _:
                self.expression.refuse(node, "only `for i in range(n)`")
        bound = self._bound(count)
        self.expression.local[name] = INT
        lines, _ = self.block(node.body, depth + 1)
        i = c_name(name)
        head = f"for (int32_t {i} = 0; {i} < {bound.text}; {i}++) {{"
        return [*self._lines(head, depth, node.iter), *lines, "    " * depth + "}"]

    def _bound(self, count: ast.expr) -> Expr:
        if isinstance(count, ast.Constant) and isinstance(count.value, int):
            return self.expression(count)
        match count:
            case ast.Call(func=ast.Name(id="int"), args=[number]):
                expression = self.expression(number)
            case _:
                self.expression.refuse(count, "only range(8) or range(int(x))")
        count_limit = self.f.__globals__.get("SUBSTEPS")
        if not isinstance(count_limit, float):
            self.expression.refuse(count, "the file states no SUBSTEPS, the bound of this loop")
        text = f"{self.program.helper('count')}({expression.text}, {int(count_limit)})"
        return Expr(text, INT, True)

    def _assign(
        self, node: ast.stmt, target: ast.expr, value: ast.expr, depth: int, top: bool
    ) -> list[str]:
        match target, value:
            case ast.Name(), _:
                expression = self.expression(value)
                text = self._assignment(target.id, expression, top)
                return self._lines(text, depth, node)
            case ast.Tuple(elts=targets), ast.Tuple(elts=values) if len(targets) == len(values):
                return self._several(node, targets, values, depth, top)
            case ast.Tuple(elts=targets), ast.Call():
                expression = self.expression(value)
                self.temporary += 1
                pair, indent = f"both_{self.temporary}", "    " * depth
                text = f"const {expression.kind.c} {pair} = {expression.text};"
                lines = self._lines(text, depth, node)
                assert isinstance(expression.kind, Struct)
                for x, (field, kind) in zip(targets, expression.kind.fields, strict=True):
                    element = Expr(f"{pair}.{field}", kind)
                    lines.append(indent + self._assignment(self._named(x), element, top))
                return lines
        self.expression.refuse(node, "only names on the left")

    def _several(
        self, node: ast.stmt, targets: list[ast.expr], values: list[ast.expr], depth: int, top: bool
    ) -> list[str]:
        """`a, b = x, y`, where no later value needs an earlier name."""
        names = [self._named(x) for x in targets]
        expressions = [self.expression(x) for x in values]
        for i, x in enumerate(values):
            if {n.id for n in _names(x, ast.Load)} & set(names[:i]):
                self.expression.refuse(node, "a later value needs an earlier name: one line each")
        lines = self._ahead(depth)
        pairs = zip(names, expressions, strict=True)
        lines += ["    " * depth + self._assignment(name, x, top) for name, x in pairs]
        lines[-1:] = self._lines(lines[-1].strip(), depth, node)
        return folded(lines)

    def _assignment(self, name: str, expression: Expr, top: bool) -> str:
        """The statement that gives a variable its value; declares it where it is new."""
        declared = self.expression.local.get(name)
        if declared not in (None, expression.kind):
            self.expression.refuse(self.node, f"{name} changes its type")
        self.expression.local[name] = expression.kind
        if declared is None and top:
            return f"{expression.kind.c} {c_name(name)} = {expression.text};"
        if declared is None:
            self.hoisted[name] = expression.kind
        return f"{c_name(name)} = {expression.text};"

    def _named(self, x: ast.expr) -> str:
        if not isinstance(x, ast.Name):
            self.expression.refuse(x, "only names on the left")
        return x.id

    def _zero(self, kind: Kind) -> str:
        if isinstance(kind, Struct):
            zeros = [self._zero(k) for _, k in kind.fields]
            return f"{{{', '.join(zeros)}}}"
        zeros_of = {self.program.types.real: self.program.number.literal(0.0), BOOL: "false"}
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
    folded_lines: list[str] = []
    for line in lines:
        deeper = " " * (len(line) - len(line.lstrip()) + 4)
        while len(line) > 100:
            least = len(deeper) + 40
            signs = (", ", " && ", " || ")
            position = max(line.rfind(sign, least, 100) + len(sign) - 1 for sign in signs)
            if position < least:
                position = line.rfind(" ", len(deeper), 101)
            if position < 0:
                break
            folded_lines.append(line[:position].rstrip())
            line = deeper + line[position:].lstrip()
        folded_lines.append(line)
    return folded_lines


def _names(node: ast.AST, context: type) -> list[ast.Name]:
    """The names that are read (`ast.Load`) or given a value (`ast.Store`)."""
    names = [n for n in ast.walk(node) if isinstance(n, ast.Name)]
    return [n for n in names if isinstance(n.ctx, context)]


def _origin(f: FunctionType) -> list[str]:
    """The comment above a function: where it is from, and what it does."""
    text = (inspect.getdoc(f) or "").splitlines() or [""]
    place = file_of(f).rpartition("adhesion_cli/")[2]
    comment = f"/* {f.__name__} of {place}: {c_types.ascii_text(text[0])} */"
    return textwrap.wrap(comment, 100, subsequent_indent="   ")
