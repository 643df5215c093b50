"""Reading of files with native libraries in a separate process, because damaged files can crash them.

``python -m crosstrack.instances.programs.apart READER`` is that process. It reads the path from
standard input and writes an archive of arrays to standard output.
"""

from __future__ import annotations

import io
import json
import os
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InvalidData
from ...models.problems import resolve
from ...models.programs.separate import answer, ask

__all__ = ["read_apart"]

#: Largest number of seconds for the process.
SECONDS = 300.0
#: Functions ``path -> (arrays, texts)`` of the process, by name.
READERS = {
    "highs": ".instances.programs.highs_files:arrays_of_file",
    "nl": ".instances.programs.nl_file:arrays_of_file",
}
#: Name of the array with the texts in JSON.
_TEXTS = "texts"


def read_apart(reader: str, path: Path, raw: bytes, suffix: str) -> tuple[dict[str, Any], Any]:
    """Return the arrays and JSON data that a reader in :data:`READERS` makes of a file.

    `path` is the file, for messages, `raw` its content after decompression, and `suffix` the one that the library
    requires. Raise ``InvalidData`` if the library refuses the file, crashes, or exceeds its time or memory.
    """
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, f"program{suffix}")
        copy.write_bytes(raw)
        completed = ask(__name__, reader, data=os.fsencode(copy), seconds=SECONDS, folder=folder)
    if completed is None:
        raise InvalidData(f"{path}: reading it took more than {SECONDS:g} s")
    if completed.returncode or not completed.stdout:
        words = completed.stderr.decode("utf-8", "replace").strip().splitlines()[-1:]
        raise InvalidData(
            f"{path}: not readable, the process that read it ended with {completed.returncode}"
            + "".join(f": {word[:200]}" for word in words)
        )
    with np.load(io.BytesIO(completed.stdout), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    texts = json.loads(arrays.pop(_TEXTS).tobytes())
    if "error" in texts:
        raise InvalidData(f"{path}: {texts['error']}")
    return arrays, texts


def _archive(data: bytes) -> bytes:
    """Return the archive of the file whose path is `data`."""
    read: Callable[[Path], tuple[Mapping[str, Any], Mapping[str, Any]]]
    read = resolve(READERS[sys.argv[1]])
    path = Path(os.fsdecode(data))
    arrays: Mapping[str, Any] = {}
    texts: Mapping[str, Any]
    try:
        arrays, texts = read(path)
    except (InvalidData, RuntimeError, ValueError, MemoryError, KeyError) as error:
        texts = {"error": str(error).replace(str(path), "the file").strip()[:300]}
    archive = io.BytesIO()
    encoded = np.frombuffer(json.dumps(texts).encode(), np.uint8)
    np.savez(archive, allow_pickle=False, **arrays, **{_TEXTS: encoded})
    return archive.getvalue()


if __name__ == "__main__":
    answer(_archive)
