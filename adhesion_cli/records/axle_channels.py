"""One axle's record with the channels that it is made of."""

from typing import NamedTuple

from ..core.model import AxleRecord, Channel


class AxleChannels(NamedTuple):
    """One axle's record and the channels it comes from."""

    record: AxleRecord
    speed: Channel
    brake: Channel
    train: Channel | None
