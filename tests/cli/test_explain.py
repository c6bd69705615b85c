"""`adhesion explain`: the catalogue's words, found by any name a code ever had."""

import json
import re

import pytest

from adhesion_cli.cli.explain import _codes, command, entry
from adhesion_cli.cli.options import completes
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.finding import catalogue


def explained(capsys: pytest.CaptureFixture[str], code: str | None, json: bool = False) -> str:
    given = {"json": json, "quiet": False, "debug": False, "code": code}
    assert command(**given) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("code", list(catalogue()))
def test_an_entry_says_cause_effect_and_remedy(code: str, capsys) -> None:
    shown = explained(capsys, code)
    assert shown.startswith(f"{code}: {catalogue()[code].title}\n")
    assert [line.split(":")[0] for line in shown.splitlines()[1:] if line[0] != " "][:3] == [
        "Cause", "Effect", "Remedy"
    ]  # fmt: skip
    assert not re.search(r"{\w+[:}]", shown)
    assert max(map(len, shown.splitlines())) <= 80


def test_a_code_is_one_entry_of_the_document(capsys) -> None:
    document = json.loads(explained(capsys, "gap", json=True))
    assert document["schema"] == "adhesion.explain/1"
    assert document["findings"] == [entry(catalogue()["gap"])]


def test_without_a_code_every_one_is_listed(capsys) -> None:
    listed = explained(capsys, None)
    assert all(f"  {words.code} " in listed for words in catalogue().values())


def test_an_unknown_code_names_the_nearest() -> None:
    with pytest.raises(UserError, match="unknown code") as error:
        command(code="presure-delay", json=False, quiet=False, debug=False)
    assert "'pressure-delay'" in error.value.hint
    assert len(error.value.hint) < 120


def test_codes_complete() -> None:
    assert completes(_codes)["autocompletion"]("vehicle-def") == ["vehicle-default"]
