"""Run the commands that the pages show, and write their output into the pages.

    python docs/outputs.py [PAGE...]          # all pages, if none is named

A block that begins with ```console has lines "$ COMMAND", each with its output below; a line that
begins with "> " continues a command. The commands of a page run one after another in a new folder
that has the sample logs in it. A block below the comment <!-- file: NAME --> is written there as a
file first. A command that fails with another exit code than 0 or 3 ends the run.

The blocks that begin with ```python run one after another, as the cells of a notebook. The block
```text below one gets what it prints, and the value of its last line.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parent
_BLOCK = re.compile(r"^```console\n(.*?)^```$", re.M | re.S)
_FILE = re.compile(r"^<!-- file: (\S+) -->\n+```\w*\n(.*?)^```$", re.M | re.S)
_CELL = re.compile(r"^```python\n(.*?)^```$(\n+^```text\n.*?^```$)?", re.M | re.S)
_NOTEBOOK = """
import ast, contextlib, io, json, sys
names, shown = {}, []
for cell in json.load(sys.stdin):
    *lines, last = ast.parse(cell).body
    value = isinstance(last, ast.Expr)
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile(ast.Module(lines + [last] * (not value), []), "cell", "exec"), names)
        if value:  # it is printed, if it is not None
            exec(compile(ast.Interactive([last]), "cell", "single"), names)
    shown.append(out.getvalue())
json.dump(shown, sys.stdout)
"""
_GOOD = (0, 3)  # 3: done, but data was lost or repaired


def rewritten(page: str) -> str:
    """The page with the output of its commands as they run now."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "sample_logs").symlink_to(DOCS.parent / "sample_logs")
        (folder / "adhesion_cli").symlink_to(DOCS.parent / "adhesion_cli")
        for file, text in _FILE.findall(page):
            (folder / file).write_text(text, encoding="utf-8")
        page = _BLOCK.sub(lambda block: _run_again(block[1], folder), page)
        return _as_notebook(page, folder) if "```text" in page else page


def _as_notebook(page: str, folder: Path) -> str:
    """The page with the output of its Python cells as they run now."""
    environment = {**os.environ, "PYTHONPATH": str(DOCS.parent), "COLUMNS": "100"}
    done = subprocess.run(
        [sys.executable, "-c", _NOTEBOOK], cwd=folder, env=environment, text=True, check=True,
        input=json.dumps([cell[1] for cell in _CELL.finditer(page)]), stdout=subprocess.PIPE,
    )  # fmt: skip
    shown = iter(json.loads(done.stdout))

    def rewritten(cell: re.Match[str]) -> str:
        lines = [line.rstrip() for line in next(shown).replace(f"{folder}/", "").splitlines()]
        below = "\n".join(["", "", "```text", *lines, "```"]) if cell[2] else ""
        return f"```python\n{cell[1]}```{below}"

    return _CELL.sub(rewritten, page)


def _run_again(block: str, folder: Path) -> str:
    commands = [of[2:] for of in re.findall(r"^\$ .*(?:\n> .*)*", block, re.M)]
    return "```console\n" + "\n".join(_shown(c, folder) for c in commands) + "\n```"


def _shown(command: str, folder: Path) -> str:
    python = f'"{sys.executable}"'
    script = f'adhesion() {{ {python} -m adhesion_cli "$@"; }}\npython() {{ {python} "$@"; }}\n'
    script += command.replace("\n> ", "\n")
    environment = {**os.environ, "PYTHONPATH": str(DOCS.parent), "COLUMNS": "100"}
    done = subprocess.run(
        ["bash", "-c", script], cwd=folder, env=environment, text=True, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    if done.returncode not in _GOOD:
        raise SystemExit(f"{command}\n{done.stdout}exit code {done.returncode}")
    lines = done.stdout.replace(f"{folder}/", "").splitlines()
    return "\n".join([f"$ {command}", *(line.rstrip() for line in lines)]).rstrip()


if __name__ == "__main__":
    for path in map(Path, sys.argv[1:] or sorted(map(str, DOCS.rglob("*.md")))):
        before = path.read_text(encoding="utf-8")
        if (page := rewritten(before)) != before:
            path.write_text(page, encoding="utf-8")
            print(path)
