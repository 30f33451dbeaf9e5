"""Writes Parquet files whole or not at all; needs the extra `parquet`."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

from data.datasets.labels import LABEL_TYPES
from data.files.files import write_atomically
from gaitpref.console.extras import require

pa = require("pyarrow", "parquet")
pq = require("pyarrow.parquet", "parquet")


def write_labels(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write the rows of `data.datasets.labels.labels`, typed even where there is none.

    Raises:
        OSError: the disk is full or not writable.
    """
    kinds = {str: pa.string(), int: pa.int64(), float: pa.float64()}
    schema = pa.schema([(name, kinds[kind]) for name, kind in LABEL_TYPES.items()])
    stream = BytesIO()
    pq.write_table(pa.Table.from_pylist(list(rows), schema=schema), stream)
    write_atomically(path, stream.getvalue())
