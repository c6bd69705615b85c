"""The page on Python shows what its cells give, as they run now."""

import importlib.util
import tempfile
from pathlib import Path

PAGE = Path(__file__).resolve().parents[2] / "docs" / "python.md"

_spec = importlib.util.spec_from_file_location("outputs", PAGE.with_name("outputs.py"))
assert _spec is not None
assert _spec.loader is not None
outputs = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(outputs)


def test_the_cells_of_the_page_give_what_it_shows() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page.count("```python") > 8
    assert outputs.rewritten(page) == page, "run: python docs/outputs.py docs/python.md"


def test_a_cell_that_fails_is_not_written_into_the_page() -> None:
    with tempfile.TemporaryDirectory() as folder:
        page = "```python\nx = 1\nx + 1\n```\n\n```text\nold\n```\n"
        assert outputs._as_notebook(page, Path(folder)) == page.replace("old", "2")
