"""Peak memory, each case in a process of its own: beside the columns nothing grows with the log."""

import gzip
import subprocess
import sys
import zlib
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from helpers.forked import Forked
from helpers.mcap_logs import MAGIC, START, double_message, proto_file, proto_schema, record
from mcap.records import Channel, Chunk, DataEnd, Footer, Header

TESTS = Path(__file__).parent
PRELUDE = """
import sys
from pathlib import Path

def peak():  # of this program alone, page cache left out [KiB]
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])

def begin():  # from here on
    Path("/proc/self/clear_refs").write_text("5")
    return peak()

path, n = Path(sys.argv[1]), int(sys.argv[2])
"""
MIB = 1024


def grown(script: str, path: Path, n: int = 0) -> int:
    """What a script prints last, as a rule a peak of memory [KiB]."""
    done = subprocess.run(
        [sys.executable, "-c", PRELUDE + script, str(path), str(n)],
        capture_output=True, text=True, check=False, cwd=TESTS.parent,
        env={"PYTHONPATH": f"{TESTS.parent}:{TESTS}", "PATH": "", "HOME": str(path.parent)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return int(done.stdout.split()[-1])


@pytest.fixture(scope="module", autouse=True)
def bytecode() -> None:
    """As installed: compiling a module leaves holes in the heap, which count as growth."""
    subprocess.run(
        [sys.executable, "-m", "compileall", "-q", str(TESTS.parent / "adhesion_cli")],
        check=True, env={},
    )  # fmt: skip


def many(path: Path, messages: int, compression: str, late: bool = False) -> None:
    """One channel of a double, 40 bytes a message; packed by numpy, as it has to be large."""
    kind = np.dtype(
        [("op", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4"),
         ("log", "<u8"), ("publish", "<u8"), ("tag", "u1"), ("value", "<f8")]
    )  # fmt: skip
    rows = np.zeros(25_000, kind)
    rows["op"], rows["length"], rows["channel"], rows["tag"] = 5, 31, 1, 9
    definitions = record(proto_schema(proto_file([double_message()]), "D"))
    definitions += record(Channel(1, "/p", "protobuf", {}, 1))
    with path.open("wb") as file:
        file.write(MAGIC + record(Header("", "")) + definitions)
        for first in range(0, messages, len(rows)):
            count = first + np.arange(len(rows))
            rows["log"] = START + (count ^ 1 if late else count) * 10**6
            rows["value"] = np.sin(count)
            raw = rows.tobytes()
            if compression:
                packed = (
                    lz4.frame.compress(raw) if compression == "lz4" else zstandard.compress(raw, 1)
                )
                raw = record(Chunk(compression, packed, 0, 0, zlib.crc32(raw), len(raw)))
            file.write(raw)
        file.write(record(DataEnd(0)) + record(Footer(0, 0, 0)) + MAGIC)


READ = """
import lz4.frame, zstandard, adhesion_cli.formats.mcap.protobuf
from adhesion_cli.formats.mcap.reader import open_mcap
from adhesion_cli.formats.source import ReadOptions
before = begin()
source = open_mcap(path, ReadOptions())
(column,) = source.columns(source.fields)
assert column.valid.all() and len(column.t) == source.rows == n
print(peak() - before - sum(x.nbytes for x in (column.t, column.value, column.valid)) // 1024)
"""


@pytest.mark.parametrize("compression", ["zstd", pytest.param("lz4", marks=pytest.mark.slow), ""])
def test_reading_mcap(tmp_path: Path, compression: str) -> None:
    many(tmp_path / "log.mcap", 1_200_000, compression)  # 46 MiB, inflated
    # 9.5 to 10.6 MiB in chunks; 17.3 without, and up to 21.6 where heap or file pages lie otherwise
    assert grown(READ, tmp_path / "log.mcap", 1_200_000) < (13 if compression else 24) * MIB


def csv_rows(first: int, stop: int) -> bytes:
    """Rows of 40 bytes, a hundredth of a second apart; made by numpy, as they are many."""
    row = b"00000.00,110.368,124.649,109.913,60.905\n"
    rows = np.tile(np.frombuffer(row, np.uint8), (stop - first, 1))
    hundredths = np.arange(first, stop)
    for k, place in enumerate((7, 6, 4, 3, 2, 1, 0)):
        rows[:, place] = ord("0") + hundredths // 10**k % 10
    return rows.tobytes()


READ_CSV = """
import os, concurrent.futures.thread, pyarrow.csv
import numpy as np
from adhesion_cli.formats.csv.reader import open_csv
from adhesion_cli.formats.source import ReadOptions
os.cpu_count = lambda: 2  # each processor has its blocks
pyarrow.array([0.0])  # nor is pandas, which Arrow loads where it is installed
before = begin()
source = open_csv(path, ReadOptions())
columns = source.columns(source.fields)
assert source.rows == n and all(c.valid.all() for c in columns)
held = columns[0].t.nbytes + sum(c.value.nbytes + c.valid.nbytes for c in columns)
print(peak() - before - held // 1024)
"""


@pytest.mark.parametrize("suffix", ["", ".gz"])
def test_reading_csv(tmp_path: Path, suffix: str) -> None:
    """The text, 80 MB, would not fit under the limit, nor a second copy of the columns."""
    rows = 2_000_000
    path = tmp_path / f"log.csv{suffix}"
    with gzip.open(path, "wb", 1) if suffix else path.open("wb") as file:
        file.write(b"time [s],p1 [bar],p2 [bar],axle_1 [km/h],axle_2 [km/h]\n")
        for first in range(0, rows, 50_000):
            file.write(csv_rows(first, first + 50_000))
    assert grown(READ_CSV, path, rows) < 64 * MIB


@pytest.mark.parametrize("command", ["--help", "analyze"])
def test_an_address_space_of_2_gb_is_enough(tmp_path: Path, command: str) -> None:
    """As with `ulimit -v 2000000`, of a compiled program. Each library would reserve most of it."""
    limited = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_AS, (2_048_000_000,) * 2);"
        "sys.argv[0] = 'adhesion'; from adhesion_cli.__main__ import main; main()"
    )
    log = str(TESTS.parent / "sample_logs" / "service-brake.csv")
    of = [] if command == "--help" else [log, "-o", str(tmp_path), "--force"]
    if of:  # compiles, which takes more
        assert Forked(TESTS.parent, [command, *of], stdout=subprocess.DEVNULL).wait(120) == 0
    done = subprocess.run(
        [sys.executable, "-c", limited, command, *of],
        capture_output=True, text=True, check=False, cwd=TESTS.parent,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert command != "analyze" or (tmp_path / "service-brake.adhesion.rrd").exists()


WRITE_LOG = """
import numpy as np
from adhesion_cli.core import threads
from adhesion_cli.core.model import Channel, Column, Log
from adhesion_cli.results import mcap, wide_table
threads.max_threads = 1  # each processor has buffers of its own
mcap.CHUNK, wide_table._ROWS = 1 << 18, 1 << 14
write_log = wide_table.writer(path)
t = np.arange(n) * 10**6
columns = (t, np.sin(t), np.ones(n, bool))
def write(n):
    data = Column(*(x[:n] for x in columns))
    channel = Channel("a", "", None, None, "N", "", data)
    write_log(path, Log("", "csv", "", True, n, (channel,), ()))
write(20_000)  # all is loaded, buffers are made
before = begin()
write(n)
print(peak() - before)
"""
WRITE_RESULT = """
from helpers.made_results import result
from adhesion_cli.core import threads
from adhesion_cli.results import mcap, rrd
threads.max_threads = 1  # each processor has buffers of its own
mcap.CHUNK, rrd.results._ROWS, rrd.parts._MOST_WAITING = 1 << 18, 1 << 12, 1 << 20
def write(n):
    whole = result(axles=1, n=n)
    before = begin()
    if path.suffix == ".mcap":
        mcap.write_results(path, [whole], "{}")
    else:
        rrd.write_results(path, [whole])
    return peak() - before
write(1000)  # all is loaded
print(write(n))
"""


@pytest.mark.parametrize("suffix", ["mcap", "csv", "parquet"])
def test_writing_a_log(tmp_path: Path, suffix: str) -> None:
    """5 MiB of columns; a table numbers its rows, 2.3 MiB."""
    assert grown(WRITE_LOG, tmp_path / f"log.{suffix}", 300_000) < 5 * MIB


@pytest.mark.parametrize("suffix", ["mcap", "rrd"])
def test_writing_a_result(tmp_path: Path, suffix: str) -> None:
    """12 MiB of columns, and as much again is computed for the file.

    Threads of the SDK hold more where they get no processor: one quiet run of three is enough.
    """
    most = 4 if suffix == "mcap" else 16  # the SDK has buffers of its own
    peaks = (grown(WRITE_RESULT, tmp_path / f"{i}.{suffix}", 100_000) for i in range(3))
    assert any(peak < most * MIB for peak in peaks)
