"""Reading of files with native libraries in a separate process, because damaged files can crash them.

``python -m crosstrack.instances.programs.apart READER`` is that process. It reads the path from
standard input and writes an archive of arrays to standard output.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InvalidData
from ...models.problems import resolve

__all__ = ["read_apart"]

#: Limits of seconds and of bytes of memory for the process.
SECONDS, MEMORY = 300.0, 8 << 30
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
        # -P: a module in the working folder must not shadow one of the standard library.
        command = [sys.executable, "-P", "-m", __name__, reader]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        try:
            completed = subprocess.run(
                command,
                input=os.fsencode(copy),
                capture_output=True,
                timeout=SECONDS,
                env=environment,
                cwd=folder,
            )
        except subprocess.TimeoutExpired:
            raise InvalidData(f"{path}: reading it took more than {SECONDS:g} s") from None
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


def _main() -> None:
    # Output of native code must not corrupt the answer.
    with os.fdopen(os.dup(1), "wb") as stream:
        os.dup2(2, 1)
        if sys.platform != "win32":
            import resource

            highest = resource.getrlimit(resource.RLIMIT_AS)[1]
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, highest))
        read: Callable[[Path], tuple[Mapping[str, Any], Mapping[str, Any]]]
        read = resolve(READERS[sys.argv[1]])
        path = Path(os.fsdecode(sys.stdin.buffer.read()))
        arrays: Mapping[str, Any] = {}
        texts: Mapping[str, Any]
        try:
            arrays, texts = read(path)
        except (InvalidData, RuntimeError, ValueError, MemoryError, KeyError) as error:
            texts = {"error": str(error).replace(str(path), "the file").strip()[:300]}
        archive = io.BytesIO()
        encoded = np.frombuffer(json.dumps(texts).encode(), np.uint8)
        np.savez(archive, allow_pickle=False, **arrays, **{_TEXTS: encoded})
        stream.write(archive.getvalue())


if __name__ == "__main__":
    _main()
