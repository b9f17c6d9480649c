"""Names of the files of a user's own that the objects of a store are from, by the number "file" of a sample.

They are no part of a data set's identity: a folder may be renamed, and the samples are the same. So they lie in a file
of their own, as they were when the store was begun, and a store without them reads as well: numbers then stay numbers.
"""

import json
from collections.abc import Sequence
from pathlib import Path

from specklegen.core.whole_files import patiently
from specklegen.datasets.store.files import json_bytes
from specklegen.datasets.store.identity import fingerprint
from specklegen.datasets.store.places import put


def write(folder: Path, names: Sequence[str]) -> None:
    """Write them, where there are any."""
    if names:
        content = {"names": list(names)}
        put(_file(folder), json_bytes({"sha256": fingerprint(content), "content": content}))


def read(folder: Path) -> tuple[str, ...]:
    """Read them; () where they are not there, or not as they were written."""
    try:
        written = json.loads(patiently(_file(folder).read_bytes))
        content = written["content"]
        return tuple(content["names"]) if fingerprint(content) == written["sha256"] else ()
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return ()


def _file(folder: Path) -> Path:
    return folder / "valid" / "names.json"
