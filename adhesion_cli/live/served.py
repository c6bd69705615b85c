"""Samples for Foxglove: a WebSocket server with the topics and messages of a result file."""

import secrets
import sys
from collections.abc import Sequence
from typing import Any

from ..core.errors import UserError, installed_by
from ..core.model import Vehicle
from ..core.physics import coefficient
from ..results import descriptors
from .axle import LiveSample, Sink
from .gate import Gate

_INSTALL = installed_by("live")
_HOST = "127.0.0.1"  # nobody else is let in
# An address of this computer that no page can guess; macOS has but the usual one.
_INNER = "127.{}.{}.{}" if sys.platform != "darwin" else _HOST


class LiveServer(Sink):
    """A server on this computer, whose port refuses pages of other web sites; raises UserError.

    On macOS, the SDK's own server behind it has the same address, on a port that changes. A port of
    0 stands for a free one.
    """

    def __init__(
        self, port: int, vehicle: Vehicle, axles: Sequence[int], algos: Sequence[str]
    ) -> None:
        try:
            import foxglove
        except ImportError:
            raise UserError("foxglove-sdk is not installed", _INSTALL) from None
        self._vehicle, context = vehicle, foxglove.Context()
        self._context = context  # without it, its channels are closed
        try:
            inner = _INNER.format(*(1 + secrets.randbelow(254) for _ in range(3)))
            self._server = foxglove.start_server(
                name="adhesion", host=inner, port=0, context=context
            )
            try:
                self._gate = Gate(_HOST, port, (inner, self._server.port))
            except OSError:
                self._server.stop()
                raise
        except Exception as error:  # the binding's word for what cannot be opened
            text = f"--serve {port}: cannot listen: {error}"
            raise UserError(text, "name another port") from None

        self._algos, self._channels = list(algos), dict[int, dict[str, Any]]()
        for n in axles:
            self._axle_topics(n)

    def _axle_topics(self, axle: int) -> dict[str, Any]:
        """The channels of an axle, which are made when it comes first."""
        import foxglove

        def channel(topic: str, message: str) -> Any:
            schema = foxglove.Schema(
                name=f"adhesion.{message}", encoding="protobuf", data=descriptors.schema(message)
            )
            return foxglove.Channel(
                topic, schema=schema, message_encoding="protobuf", context=self._context
            )

        if axle not in self._channels:
            topic = f"/axle/{axle}"
            self._channels[axle] = {
                "input": channel(f"{topic}/input", "AxleInput"),
                "slip": channel(f"{topic}/slip", "Slip"),
                **{a: channel(f"{topic}/estimate/{a}", "Estimate") for a in self._algos},
            }
        return self._channels[axle]

    @property
    def url(self) -> str:
        """Where Foxglove finds it."""
        return f"ws://{_HOST}:{self._gate.port}"

    def take(self, samples: Sequence[LiveSample]) -> None:
        """See `Sink`."""
        for s in samples:
            topics = self._axle_topics(s.axle)
            measured = {"brake_cylinder_pressure": s.pressure, "clamping_force": s.clamping}
            measured |= {"wheel_speed": s.speed, "train_speed": s.train}
            self._send(topics["input"], "AxleInput", s.t, **measured)
            self._send(topics["slip"], "Slip", s.t, slip=s.slip)
            for algo, e in s.estimates.items():
                mu = float(coefficient(e.force, self._vehicle, s.axle))  # type: ignore[arg-type]
                estimate = {"force": e.force, "coefficient": mu, "sigma": e.sigma}
                self._send(topics[algo], "Estimate", s.t, **estimate)

    def _send(self, channel: Any, message: str, t: int, **values: float) -> None:
        encoded: Any = descriptors.message(message)(**values)
        encoded.timestamp.FromNanoseconds(max(t, 0))
        channel.log(encoded.SerializeToString(), log_time=max(t, 0))

    def close(self) -> None:
        """See `Sink`."""
        self._gate.close()
        self._server.stop()
