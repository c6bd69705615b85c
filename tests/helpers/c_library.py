"""Exports compiled into libraries, called from Python: a state of C beside a state of Python."""

import ctypes
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import pytest

from adhesion_cli.core.estimator import Estimator
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import wheelset
from adhesion_cli.export import files
from adhesion_cli.export.c_types import DOUBLE
from adhesion_cli.export.interface import Interface

W = wheelset(Vehicle(), 1)
STRICT = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-pedantic"]


def tool(name: str) -> str:
    """The path of a program; the test is skipped where it is missing."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


def flat(x: Any) -> list[float]:
    """The numbers in a NamedTuple."""
    return [y for z in x for y in flat(z)] if isinstance(x, tuple) else [x]


class CMethod:
    """One export in double precision."""

    def __init__(self, folder: Path, name: str) -> None:
        self.name, self.method = name, files.methods()[name]
        vehicle = (W.radius, W.phi, W.inertia, W.mass)
        code = Interface(self.method, self.method.Params(), vehicle, DOUBLE, "test").code()
        (folder / f"adhesion_{name}.h").write_text(code.header, encoding="ascii")
        (folder / f"adhesion_{name}.c").write_text(code.source, encoding="ascii")
        library = folder / f"{name}.so"
        source = str(folder / f"adhesion_{name}.c")
        command = [tool("gcc"), *STRICT, "-Werror", "-shared", "-fPIC", "-o", str(library), source]
        subprocess.run([*command, "-lm"], check=True)
        self.library: Any = ctypes.CDLL(str(library))
        self.read = code.read
        self.statuses = [status for status, _ in code.statuses]
        self.estimator = isinstance(self.method, Estimator)
        self.before = self.offset()
        self.memory = (ctypes.c_double * 256)()  # more than any state

    def _call(self, function: str, *arguments: Any) -> str:
        call = getattr(self.library, f"adhesion_{self.name}_{function}")
        given = [ctypes.c_double(x) if isinstance(x, float) else x for x in arguments]
        return self.statuses[call(*given)]

    def _inputs(self, inputs: Any) -> list[Any]:
        """K and y of an estimator; what a controller observes, by reference."""
        if self.estimator:
            return [float(x) for x in inputs]
        of = (ctypes.c_double * len(inputs))(*map(float, inputs[:-1]), 0.0)
        whole = ctypes.cast(ctypes.byref(of, 8 * (len(inputs) - 1)), ctypes.POINTER(ctypes.c_int32))
        whole[0] = int(inputs[-1])
        return [ctypes.byref(of)]

    def init(self, p: Any, inputs: Any, w: Any = W) -> str:
        """The status."""
        given = [(ctypes.c_double * len(x))(*x) for x in ((p, w) if self.estimator else (p,))]
        return self._call("init", self.memory, *map(ctypes.byref, given), *self._inputs(inputs))

    def step(self, h: float, inputs: Any) -> str:
        """The status."""
        return self._call("step", self.memory, float(h), *self._inputs(inputs))

    def has(self, state: Any) -> bool:
        """Whether the method's own state has the bits of one of Python."""
        numbers = flat(state)
        whole = 0 if self.estimator else 1  # a controller's state ends with its valve
        wanted = struct.pack(f"{len(numbers) - whole}d{whole}i", *numbers)
        return bytes(self.memory)[8 * self.before :].startswith(wanted)

    def offset(self) -> int:
        """The numbers before it: the mark of init, what was given, what is kept from it."""
        p = self.method.Params()
        if not self.estimator:
            return 1 + len(p)
        return 1 + len(p) + len(W) + self.statuses.count("TOO_LONG")
