"""Logs as Parquet: one column per channel with its unit in the field's metadata."""

from pathlib import Path

import pyarrow as pa

from ..core.model import Log
from ..core.text import distinct
from . import names, wide_table
from .verified import verified


def write_log(path: Path, log: Log) -> None:
    """Write a log as a wide table, see `wide_table`.

    A row group holds as many rows as are made at once. Each page has a checksum.

    Args:
        path: file to write; its old content is lost.
        log: channels with a meaning are in SI, others in the unit they state.

    Raises:
        OSError: the file cannot be written.
        UserError: it does not read back.
    """
    from pyarrow.parquet import ParquetWriter

    columns = [("time", "" if log.absolute else "s"), *names.channels(log)]
    titles = distinct([name for name, _ in columns])
    schema = pa.schema(
        [
            pa.field(title, kind, metadata={"unit": unit} if unit else None)
            for title, (_, unit), kind in zip(titles, columns, wide_table.types(log), strict=True)
        ]
    )
    with (
        verified(path) as file,
        ParquetWriter(file, schema, compression="zstd", write_page_checksum=True) as writer,
    ):
        for rows in wide_table.batches(log):
            writer.write_batch(pa.record_batch(rows, schema=schema))
