"""How large an installation is: without PyTorch, with it, and what each extra adds.

    python -m build --wheel && python packaging/install_sizes.py dist/specklegen_torch-0.1.0-py3-none-any.whl

Each row is a clean virtual environment, and its number what `du` counts under site-packages less what a new environment
has there. PyTorch is the build that the variable TORCH names. Extras are read from the file, so that an older version's
can be measured by the same command; those named by ``--leave-out`` are not.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from email.parser import HeaderParser
from pathlib import Path


def main() -> None:
    """Install, measure, print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, help="a wheel")
    parser.add_argument("--python", default=sys.executable, help="interpreter of the new environments")
    parser.add_argument("--leave-out", nargs="*", default=["dev", "docs"], metavar="EXTRA", help="not to measure")
    chosen = parser.parse_args()
    needed, extras = requirements(chosen.file)
    print("| site-packages | MB |\n|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        environments = Environments(chosen.python, Path(folder))
        core = environments.new("core", needed, ["--no-deps", str(chosen.file.resolve())])
        row("the package, without PyTorch", environments.size(core))
        torch = environments.copy(core, "torch", [os.environ.get("TORCH", "torch==2.13.0")])
        row("with the extra `torch`", environments.size(torch))
        for extra, lines in extras.items():
            if extra not in ("torch", "all", *chosen.leave_out):
                more = environments.copy(torch, extra, lines)
                row(f"extra `{extra}` adds", environments.size(more) - environments.size(torch))


def row(name: str, size: float) -> None:
    """Print a row of the table, in MB of a million bytes."""
    print(f"| {name} | {size / 1e6:.1f} |", flush=True)


def requirements(wheel: Path) -> tuple[list[str], dict[str, list[str]]]:
    """What a wheel requires, and what each of its extras does."""
    archive = zipfile.ZipFile(wheel)
    (name,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
    told = HeaderParser().parsestr(archive.read(name).decode())
    extras: dict[str, list[str]] = {each: [] for each in told.get_all("Provides-Extra", [])}
    needed = []
    for line in told.get_all("Requires-Dist", []):
        wanted, _, marker = line.partition(";")
        extra = re.search(r"extra == ['\"](.*?)['\"]", marker)
        (extras[extra[1]] if extra else needed).append(wanted.strip())
    return needed, extras


class Environments:
    """Virtual environments in a folder."""

    def __init__(self, python: str, folder: Path) -> None:
        self.python, self.folder = python, folder
        self.empty = self.size(self.new("empty"))

    def new(self, name: str, *installs: list[str]) -> Path:
        """Make one and install each list in turn."""
        made = self.folder / name
        run([self.python, "-m", "venv", made])
        for words in installs:
            self._install(made, words)
        return made

    def copy(self, base: Path, name: str, words: list[str]) -> Path:
        """Install more into a copy, whose files are links to those of the other until they are replaced."""
        made = self.folder / name
        run(["cp", "-al", base, made])
        self._install(made, words)
        return made

    def size(self, made: Path) -> int:
        """Bytes on the disk under site-packages, beyond those of an empty environment."""
        (packages,) = made.glob("lib/python3*/site-packages")
        said = subprocess.run(["du", "-s", "--block-size=1", packages], capture_output=True, text=True, check=True)
        return int(said.stdout.split()[0]) - getattr(self, "empty", 0)

    @staticmethod
    def _install(made: Path, words: list[str]) -> None:
        run([made / "bin" / "python", "-m", "pip", "install", "--quiet", *words])


def run(words: list) -> None:
    """Run a program that must not see this checkout, its output on standard error."""
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    subprocess.run([str(word) for word in words], env=clean, check=True, stdout=sys.stderr)


if __name__ == "__main__":
    main()
