"""Public measurements of other laboratories: where they are, what may be done with them, and their digests.

Nothing of them comes with the package. A user fetches them by git, into a clone of his own, and only the files that are
named here; every file is then held against its SHA-256.
"""

import hashlib
import json
import subprocess
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

from specklegen.core.errors import counted, reject

_BLOCK = 2**20
_PATIENCE = 1800  # seconds that git may take


@dataclass(frozen=True)
class PublicData:
    """A set of measurements in a public repository.

    Attributes
    ----------
    name, what : str
    repository : str
        On GitHub, owner/name.
    commit : str
    licence : str
        "none" where the authors state none: to be read from your own clone, and not to be handed on.
    files : dict of str to str
        SHA-256 by path.

    Examples
    --------
    >>> from specklegen.measured import public_data
    >>> public_data("vessel").licence, list(public_data("vessel").files)
    ('Apache-2.0', ['data.mat'])
    """

    name: str
    repository: str
    commit: str
    licence: str
    what: str
    files: dict[str, str]

    @property
    def address(self) -> str:
        """Address of the repository."""
        return f"https://github.com/{self.repository}"

    def broken(self, folder: str | Path) -> dict[str, str]:
        """Files that a clone lacks, or has with another content: why, by path. Empty where all is as it should be."""
        faults = {}
        for name, digest in self.files.items():
            path = Path(folder) / name
            if not path.is_file():
                faults[name] = "is missing"
            elif _digest(path) != digest:
                faults[name] = "differs from the commit"
        return faults

    def get(self, folder: str | Path, source: str | None = None) -> Path:
        """Clone the files of the set into a folder, unless they are there, and check their digests.

        Raise a `RuleError` if git fails, or a file has another content.

        Parameters
        ----------
        folder
            A new one, or one with the files.
        source
            Address or path of another clone of the same repository; by default that on GitHub.
        """
        folder = Path(folder)
        if folder.exists() and not folder.is_dir():
            reject("measured get --out", "a folder", str(folder))
        if not folder.exists() or not any(folder.iterdir()):
            folder.parent.mkdir(parents=True, exist_ok=True)
            clone = ("clone", "--quiet", "--filter=blob:none", "--no-checkout", "--", source or self.address)
            _git(*clone, str(folder))
            _git("-C", str(folder), "-c", "core.autocrlf=false", "checkout", "--quiet", self.commit, "--", *self.files)
        broken = self.broken(folder)
        if broken:
            first = next(iter(broken))
            more = f", and {counted(len(broken) - 1, 'file')} more" if len(broken) > 1 else ""
            reject(f"measured get {self.name}", f"a folder of the files of commit {self.commit[:7]}", str(folder),
                   f"{first} {broken[first]}{more}: give an empty folder by --out.")  # fmt: skip
        return folder


@lru_cache(1)
def _catalogue() -> dict[str, PublicData]:
    entries = json.loads((files("specklegen.measured") / "public_data.json").read_text(encoding="utf-8"))
    return {each["name"]: PublicData(**each) for each in entries}


def public_data_names() -> tuple[str, ...]:
    """Names of the public measurements that the package knows of.

    Examples
    --------
    >>> from specklegen.measured import public_data_names
    >>> "vessel" in public_data_names()
    True
    """
    return tuple(_catalogue())


def public_data(name: str) -> PublicData:
    """One of the public measurements, by its name.

    Raise a `RuleError` if there is none of that name.

    Parameters
    ----------
    name
        One of ``public_data_names()``.

    Examples
    --------
    >>> from specklegen.measured import public_data
    >>> public_data("spheres").repository
    'scottprahl/iad'
    """
    if not isinstance(name, str) or name not in _catalogue():
        reject("public_data name", f"one of {', '.join(_catalogue())}", name)
    return _catalogue()[name]


def _digest(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def _git(*words: str) -> None:
    try:
        done = subprocess.run(["git", *words], capture_output=True, text=True, timeout=_PATIENCE, check=False)
    except FileNotFoundError:
        reject("measured get", "run where git is installed", "no git")
    except subprocess.TimeoutExpired:
        reject("measured get", f"done in {_PATIENCE} seconds", "no end", "Try again, or give a clone by --source.")
    if done.returncode:
        lines = done.stderr.strip().splitlines() or [f"status {done.returncode}"]
        reject("measured get", "a repository that git can clone", lines[-1], "Give another clone by --source.")
