"""Names from logs reach no terminal raw, and no file outside the ones asked for."""

import csv
import json
import unicodedata
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest
from helpers.systems import not_on_windows
from mcap.writer import Writer

pytestmark = not_on_windows("forbids such names")
Run = Callable[..., CompletedProcess[str]]
EVIL = "\x1b[2J\x1b]0;x\x07\u202e\u2066\x9b31m\x7f<script>alert(1)</script>"
NAME = "m\x1b[31m\u202e<b>.mcap"
UNSAFE = {"Cc", "Cf", "Cs", "Zl", "Zp"}


def hostile(path: Path) -> None:
    """A log of one brake application whose every name is hostile."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(EVIL, EVIL)
        schema = writer.register_schema(f"x{EVIL}", "jsonschema", b"{}")
        channels = {
            name: writer.register_channel(
                f"={name} {EVIL}", "json", schema, {"unit": unit, EVIL: EVIL}
            )
            for name, unit in (("bc pressure", "bar"), ("wheel speed", "km/h"))
        }  # fmt: skip
        other = writer.register_channel(f"@SUM(1){EVIL}", f"odd{EVIL}", 0)
        writer.add_message(other, 0, b"x", 0)
        for i in range(400):
            values = {"bc pressure": min(i / 100, 3.0), "wheel speed": 80.0 - 0.04 * i}
            for name, value in values.items():
                body = json.dumps({"value": value, "label": EVIL, f"k{EVIL}": 3}).encode()
                writer.add_message(channels[name], i * 20_000_000, body, 0)
        writer.add_attachment(0, 0, f"../up{EVIL}", "text/plain", b"evil")
        writer.add_attachment(0, 0, str(path.with_name("absolute")), "text/plain", b"evil")
        writer.add_metadata(f"m{EVIL}", {EVIL: EVIL})
        writer.finish()


@pytest.mark.parametrize("more", [[], ["--json"]], ids=["text", "json"])
@pytest.mark.parametrize(
    "command",
    [
        ["inspect", NAME],
        ["analyze", NAME],
        ["recover", NAME, "-o", f"r{NAME}"],
        ["convert", NAME, f"{NAME}.csv"],
        ["convert", NAME, f"c{NAME}"],
        ["analyze", NAME, "--set", f"x{EVIL}=1"],
        ["inspect", f"none{NAME}"],
        pytest.param(["compare", NAME], marks=pytest.mark.slow),
        pytest.param(["slip", NAME, "--axle", "1"], marks=pytest.mark.slow),
    ],
    ids=lambda c: " ".join(c).replace(NAME, "LOG").replace(EVIL, ""),
)
def test_hostile_names(run: Run, tmp_path: Path, command: list[str], more: list[str]) -> None:
    folder = tmp_path / "here"
    folder.mkdir()
    hostile(folder / NAME)
    before = set(tmp_path.iterdir())
    done = run(*(f"here/{c}" if NAME in c else c for c in command), *more)
    assert "internal error" not in done.stderr + done.stdout
    for c in done.stdout + done.stderr:
        assert c == "\n" or unicodedata.category(c) not in UNSAFE
    if more:
        json.loads(done.stdout)
    made = {p.name for p in set(tmp_path.iterdir()) - before}
    assert all(name.startswith(NAME[:-5]) for name in made)  # results of the current folder
    assert not (folder / "absolute").exists()
    if (table := folder / f"{NAME}.csv").exists():
        with table.open(newline="") as file:
            header = next(csv.reader(file))
        assert len(header) > 2
        assert not any(cell[0] in "=+-@\t\r" for cell in header)
