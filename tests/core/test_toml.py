"""Files of settings."""

from pathlib import Path

from adhesion_cli.core import toml


def test_a_byte_order_mark_is_no_setting(tmp_path: Path) -> None:
    """Editors of Windows write one."""
    path = tmp_path / "a.toml"
    path.write_text("vehicle.friction = 0.3", "utf-8-sig")
    assert toml.read(path, "") == {"vehicle": {"friction": 0.3}}
