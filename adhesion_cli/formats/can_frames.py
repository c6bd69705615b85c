"""A CAN frame, and what is wrong with a log of frames."""

from dataclasses import dataclass, field
from typing import NamedTuple


class Frame(NamedTuple):
    """One frame of a log."""

    t: float  # after the start of the log [s]
    bus: int  # from 0
    identifier: int  # -1 where the log names the message
    extended: bool = False
    data: bytes = b""
    kind: str = "data"  # or "remote", "error"; "event" of a line with a time and no frame
    name: str = ""  # of the message, where the log has no number


@dataclass(slots=True)
class Problems:
    """What is wrong with a log."""

    damage: str = ""
    lines: list[int] = field(default_factory=list)  # that hold a frame which cannot be read
    example: str = ""  # the first of them
    errors: list[float] = field(default_factory=list)  # times of error frames, after the start [s]
    has_steps: bool = False  # whether times count from the line before
    losses: list[float] = field(default_factory=list)  # times at which the logger notes a loss [s]

    def note(self, damage: str) -> None:
        """Notes damage; the first is the one that people are shown."""
        self.damage = self.damage or damage
