"""What a damaged file has lost, and which of its messages may have changed."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from .records import DamageError


@dataclass(frozen=True, slots=True)
class Account:
    """The account of one file. A copy of it carries the account on, as its fresh CRCs hide all."""

    damage: Sequence[DamageError]
    rows: int  # messages of channels that the file defines
    stray: int  # messages of other channels
    unguarded: int  # messages that no CRC of the file guards
    changed: bool  # whether some of the bytes that messages stand in are known to be wrong
    counted: int | None  # messages by its statistics
    past: Mapping[str, str]  # the account of the file that it was made from, {} for none

    @property
    def unchecked(self) -> int:
        """Messages that no CRC guards, or none did before they were recovered."""
        return self.unguarded + min(self._before("unchecked"), self.rows)

    @property
    def suspect(self) -> int:
        """Messages of these that may have changed."""
        return self.unchecked if self.changed else min(self._before("suspect"), self.rows)

    @property
    def lost(self) -> int | None:
        """Messages that the statistics count and that are not whole; None without statistics."""
        if self.counted is None:
            return None
        return max(self.counted - self.rows - self.stray, 0)

    def _before(self, what: str) -> int:
        count = self.past.get(what, "0")
        return int(count) if re.fullmatch("[0-9]{1,18}", count) else 0

    def as_metadata(self) -> dict[str, str]:
        """What a copy must say about itself, {} for a sound file."""
        if not (self.damage or self.unguarded or self.stray):
            return dict(self.past)
        found = [f"byte {one.at}: {one.what}" for one in self.damage[:1]]
        if len(self.damage) > 1:
            found.append(f"{len(self.damage) - 1} more")
        if self.stray and not found:
            found.append(f"{self.stray} messages of channels that it does not define")
        if before := self.past.get("damage"):
            found.append(f"before: {before}")
        unknown = self.lost is None or self.past.get("lost") == "unknown"
        lost = (self.lost or 0) + self.stray + self._before("lost")
        return {
            "damage": "; ".join(found)[:1000],
            "lost": "unknown" if unknown else str(lost),
            "unchecked": str(self.unchecked),
            "suspect": str(self.suspect),
        }
