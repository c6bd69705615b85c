"""Results as pages, and what a page holds."""

import json
import re
import zlib
from base64 import b64decode
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from adhesion_cli.analysis.settings import Settings, tree
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.document import embedded
from adhesion_cli.core.model import Result, Vehicle
from adhesion_cli.results import mcap
from helpers import made_results

EVIL = '<img src=x onerror="alert(1)">\'"</script><b>'


def analysed(**of: Any) -> Result:
    """A made result with the settings of a real one."""
    return replace(made_results.result(**of), settings=tree(Settings(Vehicle()), []))


def written(path: Path, result: Result) -> Path:
    mcap.write_results(path, [result], embedded([summarise(result, {})]))
    return path


class Elements(HTMLParser):
    """The elements of a page, and the text between them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def figures(text: str) -> dict[str, object]:
    packed = re.search(r'id="figures">([^<]*)<', text)
    assert packed
    found: dict[str, object] = json.loads(zlib.decompress(b64decode(packed[1])))
    return found
