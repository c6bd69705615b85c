"""Pages that the program writes are up to date, and what messages and scripts point to is there."""

import importlib.util
import re
from pathlib import Path

import pytest

from adhesion_cli.core.finding import catalogue

ROOT = Path(__file__).resolve().parents[1]

_spec = importlib.util.spec_from_file_location("generate", ROOT / "docs" / "generate.py")
assert _spec is not None
assert _spec.loader is not None
generate = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(generate)


@pytest.mark.parametrize("name", list(generate.PAGES))
def test_generated_page_is_up_to_date(name: str) -> None:
    page = (ROOT / "docs" / name).read_text(encoding="utf-8")
    assert page == generate.PAGES[name](), "run: python docs/generate.py"


def test_the_help_shows_no_type_of_python() -> None:
    assert not re.search(r"[{}]|<(list|path|str|int)", generate.cli_page())


def pages() -> list[Path]:
    return [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]


def test_pages_that_the_program_names_exist() -> None:
    named = {
        (path.name, page)
        for path in (*ROOT.glob("adhesion_cli/**/*.py"), *pages())
        for page in re.findall(r"\bdocs/[a-z_/-]+\.md", path.read_text(encoding="utf-8"))
    }
    assert ("CONTRIBUTING.md", "docs/settings.md") in named
    assert not [(where, page) for where, page in named if not (ROOT / page).is_file()]


def test_links_between_pages_lead_somewhere() -> None:
    broken = []
    for page in pages():
        for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
            if not link.startswith("http"):
                file, _, heading = link.partition("#")
                target = page.parent / file if file else page
                if not target.exists() or (heading and heading not in headings(target)):
                    broken.append((page.name, link))
    assert broken == []


def headings(page: Path) -> set[str]:
    """The anchors that a page's headings get on a code host."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    titles = re.findall(r"^#+ (.*)$", text, re.M)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


def test_codes_of_findings_that_pages_name_exist() -> None:
    folders = [ROOT / "docs" / name for name in ("howto", "explanation")]
    named = {
        (page.name, code)
        for page in (*(p for folder in folders for p in folder.glob("*.md")), ROOT / "README.md")
        for code in re.findall(r"`([a-z]+(?:-[a-z]+)+)`", page.read_text(encoding="utf-8"))
    }
    scenarios = {path.stem for path in (ROOT / "adhesion_cli/wsp/scenarios").iterdir()}
    known = {*catalogue(), *scenarios}
    assert len(named) > 20
    assert sorted((page, code) for page, code in named if code not in known) == []


def test_every_figure_is_made_by_a_command_of_its_page() -> None:
    makes = {
        "viewer.png": "adhesion view",
        "viewer-axle.png": "adhesion view",
        "viewer-slip.png": "adhesion view",
        "report.png": "adhesion report",
    }
    shown = {
        (page, name)
        for page in pages()
        for name in re.findall(r"figures/([a-z-]+\.\w+)\)", page.read_text(encoding="utf-8"))
    }
    stored = {path.name for path in (ROOT / "docs" / "figures").iterdir()}
    assert {name for _, name in shown} == stored
    for page, name in shown:
        assert makes[name] in page.read_text(encoding="utf-8"), (page, name)
        assert (ROOT / "docs" / "figures" / name).stat().st_size < 300_000


def test_tests_that_are_named_exist() -> None:
    page = (ROOT / "docs" / "validation.md").read_text(encoding="utf-8")
    named = re.findall(r"`[a-z/]*test_\w+\.py::(\w+)`", page)
    tests = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py"))
    assert len(named) > 10
    assert [name for name in named if f"def {name}(" not in tests] == []


def test_the_gate_runs_the_readmes_test_command() -> None:
    (command,) = re.findall(r"^python3 -m venv .*pytest.*$", (ROOT / "README.md").read_text(), re.M)
    assert command.endswith("pytest -n 2")
    gate = (ROOT / ".ci" / "run").read_text()
    assert "grep -m 1 '^python3 -m venv .*pytest' README.md" in gate
    assert "pip install" not in gate + (ROOT / "CONTRIBUTING.md").read_text()
