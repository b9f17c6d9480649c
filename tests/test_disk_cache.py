"""The cache on disk: whole files or none, within limits, of trusted users alone; its digest of sources."""

import ast
import errno
import hashlib
import multiprocessing
import os
import re
import shutil
import stat
import tempfile
import warnings
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from scenes import ROOT

from specklegen import disk_cache
from specklegen.disk_cache import LIMITS, read, sources_of, write

KERNELS = sorted((ROOT / "specklegen").glob("**/kernels/*.py"))
AS_ROOT = pytest.mark.skipif(os.getuid() != 0, reason="gives files to another user, which takes the administrator")
BOB = 12345
"""Number of a user who is neither this one nor the administrator."""


@pytest.fixture
def root(tmp_path, monkeypatch) -> Path:
    """An empty cache, in a process that has neither written nor warned."""
    monkeypatch.setenv("SPECKLEGEN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(disk_cache, "_written", {})
    monkeypatch.setattr(disk_cache, "_warned", set())
    return tmp_path / "cache"


def said(act, text: str, times: int = 1):
    """Return the result of an act that warns so many times, with such a text."""
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        result = act()
    assert [re.search(text, str(warning.message)) is not None for warning in warned] == [True] * times
    return result


@pytest.mark.parametrize(("setting", "kernels", "pilots"), [
    ("/else", "/else/kernels", "/else/pilots"), ("off", None, None), ("kernels:/else", "/else/kernels", None),
    ("", "/.cache/specklegen/kernels", "/.cache/specklegen/pilots"), ("kernels:", "/.cache/specklegen/kernels", None),
])  # fmt: skip
def test_one_setting_moves_the_cache_or_switches_it_off(monkeypatch, setting, kernels, pilots):
    monkeypatch.setenv("SPECKLEGEN_CACHE", setting)
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name: f"/.cache/{name}")
    assert [str(disk_cache.folder_of(kind)) for kind in ("kernels", "pilots")] == [str(kernels), str(pilots)]


def test_nothing_is_read_or_written_where_it_is_switched_off(root, monkeypatch):
    write("pilots", "name", b"abc")
    monkeypatch.setenv("SPECKLEGEN_CACHE", "off")
    write("pilots", "other", b"abc")
    assert read("pilots", "name") is None
    assert [path.name for path in root.rglob("*") if path.is_file()] == ["name"]


def test_damaged_files_are_not_read_and_are_replaced(root):
    assert read("pilots", "name") is None
    for content in (b"", b"abc"):
        write("pilots", "name", content)
        assert read("pilots", "name") == content
    file = root / "pilots" / "name"
    whole = file.read_bytes()
    for n, damaged in enumerate((b"", whole[:20], whole[:-1], whole + b"d", bytes([whole[0] ^ 1]) + whole[1:])):
        file.write_bytes(damaged)
        assert said(lambda: read("pilots", "name"), "is damaged", times=n == 0) is None
    write("pilots", "name", b"abc")
    assert file.read_bytes() == whole


def test_new_folders_and_files_are_their_users_alone(root):
    before = os.umask(0)
    try:
        write("pilots", "name", b"abc")
    finally:
        os.umask(before)
    assert all(path.stat().st_mode & 0o077 == 0 for path in (root, *root.rglob("*")))


# Limits
@pytest.mark.parametrize(("most", "most_bytes"), [(3, 2**20), (100, 3500)])
def test_the_oldest_files_make_room(root, most, most_bytes):
    for n in range(6):
        write("pilots", f"{n}", bytes(1000))
        os.utime(root / "pilots" / f"{n}", (n, n))
    disk_cache._sweep(root / "pilots", most, most_bytes)
    assert sorted(path.name for path in (root / "pilots").iterdir()) == ["3", "4", "5"]


def test_a_file_of_more_than_its_share_is_not_written(root, monkeypatch):
    monkeypatch.setitem(LIMITS, "pilots", (10, 16_000))
    write("pilots", "small", bytes(1000))
    write("pilots", "large", bytes(1001))
    assert [path.name for path in (root / "pilots").iterdir()] == ["small"]


def test_what_killed_processes_left_goes_with_the_oldest(root, monkeypatch):
    monkeypatch.setitem(LIMITS, "pilots", (3, 2**20))
    (root / "pilots").mkdir(parents=True, mode=0o700)
    half = root / "pilots" / "tmp123"
    half.write_bytes(b"half")
    os.utime(half, (0, 0))
    for n in range(2 * disk_cache._SWEEP):
        write("pilots", f"{n}", b"abc")
    assert not half.exists()
    assert len(list((root / "pilots").iterdir())) <= 3 + disk_cache._SWEEP


# What cannot be written
def blocked(root, _):
    root.write_text("in the way")


def full(_, monkeypatch):
    monkeypatch.setattr(tempfile, "NamedTemporaryFile", Mock(side_effect=OSError(errno.ENOSPC, "no space left")))


@pytest.mark.parametrize("way", [blocked, full])
def test_a_folder_that_cannot_be_written_is_said_once_and_not_tried_again(root, monkeypatch, way):
    way(root, monkeypatch)
    for times in (1, 0):
        said(lambda: write("pilots", "name", b"abc"), "Set SPECKLEGEN_CACHE to a folder that you can write", times)
        assert read("pilots", "name") is None
    assert disk_cache._written[str(root / "pilots")] == disk_cache.MOST_OF_A_PROCESS


def test_the_administrators_cache_is_read_in_silence(root, monkeypatch):
    write("pilots", "name", b"abc")
    monkeypatch.setattr(tempfile, "NamedTemporaryFile", Mock(side_effect=PermissionError(errno.EACCES, "denied")))
    monkeypatch.setattr(os, "access", lambda *_: False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write("pilots", "other", b"abc")
        assert read("pilots", "name") == b"abc"


# Who may have written
@pytest.mark.parametrize(("kind", "owner", "mode", "reason"), [
    ("DIR", 7, 0o700, None), ("DIR", 7, 0o755, None), ("REG", 7, 0o644, None), ("DIR", 0, 0o755, None),
    ("DIR", 0, 0o1777, None), ("LNK", 7, 0o777, None), ("LNK", BOB, 0o777, "belongs to another user"),
    ("DIR", BOB, 0o755, "belongs to another user"), ("DIR", BOB, 0o1777, "belongs to another user"),
    ("REG", BOB, 0o644, "belongs to another user"), ("DIR", 7, 0o777, "can be written by other users"),
    ("DIR", 7, 0o775, "can be written by other users"), ("DIR", 0, 0o777, "can be written by other users"),
    ("REG", 7, 0o1666, "can be written by other users"), ("REG", 7, 0o664, "can be written by other users"),
])  # fmt: skip
def test_only_this_user_and_the_administrator_are_trusted(monkeypatch, kind, owner, mode, reason):
    monkeypatch.setattr(os, "getuid", lambda: 7)
    status = SimpleNamespace(st_uid=owner, st_gid=70, st_mode=getattr(stat, f"S_IF{kind}") | mode)
    monkeypatch.setattr(disk_cache, "_is_private", lambda group: False)
    assert disk_cache._suspicion(status) == reason
    monkeypatch.setattr(disk_cache, "_is_private", lambda group: group == 70)  # that of this user alone may write
    assert disk_cache._suspicion(status) == (None if mode & 0o002 == 0 and owner == 7 else reason)


@pytest.mark.parametrize(("name", "number", "members", "private"), [
    ("ann", 70, [], True), ("ann", 70, ["ann"], True), ("ann", 70, ["bob"], False), ("staff", 70, [], False),
    ("ann", 71, [], False),
])  # fmt: skip
def test_a_group_is_private_that_has_its_users_name_and_no_other_member(monkeypatch, name, number, members, private):
    monkeypatch.setattr("pwd.getpwuid", lambda _: SimpleNamespace(pw_name="ann", pw_gid=70))
    monkeypatch.setattr("grp.getgrgid", lambda _: SimpleNamespace(gr_name=name, gr_mem=members))
    assert disk_cache._is_private.__wrapped__(number) is private


def swapped(root: Path, kind: str) -> None:
    """Put a folder in place of another one, as whoever can write the folder above can."""
    content = b"wrong"
    (root / kind).rename(root / "aside")
    (root / kind).mkdir(mode=0o755)
    (root / kind / "name").write_bytes(hashlib.sha256(content).digest() + content)


def opened(root, kind):
    root.chmod(0o777)
    swapped(root, kind)


def given_away(root, kind):
    swapped(root, kind)
    os.chown(root / kind / "name", BOB, BOB)


def given_away_above(root, kind):
    swapped(root, kind)
    os.chown(root, BOB, BOB)


def linked(root, kind):
    """A link whose target lies in a folder that others can write."""
    swapped(root, kind)
    open_folder = root.parent / "open"
    open_folder.mkdir()
    open_folder.chmod(0o777)
    (root / kind).rename(open_folder / kind)
    (root / kind).symlink_to(open_folder / kind)


def writable(root, kind):
    swapped(root, kind)
    (root / kind / "name").chmod(0o666)


@pytest.mark.parametrize("kind", LIMITS)
@pytest.mark.parametrize("change", [opened, linked, writable, pytest.param(given_away, marks=AS_ROOT),
                                    pytest.param(given_away_above, marks=AS_ROOT)])  # fmt: skip
def test_what_others_could_have_put_there_is_not_read(root, change, kind):
    """Also where it was checked before: the kernels of another user ran, whose folder took the place of this one."""
    write(kind, "name", b"right")
    assert read(kind, "name") == b"right"
    change(root, kind)
    reason = "another user|can be written by other users"
    text = f"is not used, since other users could have changed it.*({reason}).*set SPECKLEGEN_CACHE to a folder that "
    assert said(lambda: read(kind, "name"), text) is None
    assert said(lambda: read(kind, "name"), text, times=0) is None
    said(lambda: write(kind, "other", b"abc"), text, times=0)
    assert (root / kind / "other").exists() == (change in (writable, given_away))  # of one file, and not of its folder


def test_a_folder_below_one_that_others_can_write_holds_nothing(root):
    root.parent.chmod(0o777)
    with pytest.warns(UserWarning, match=f"{root.parent} can be written by other users"):
        write("pilots", "name", b"abc")
    assert not [path for path in root.rglob("*") if path.is_file()]


def test_a_sticky_folder_above_is_trusted(root):
    root.parent.chmod(0o1777)
    write("pilots", "name", b"abc")
    assert read("pilots", "name") == b"abc"


# Several at once
def use(start, answers) -> None:
    """Read, write and delete a few files as fast as can be; note what is neither whole nor absent."""
    start.wait()
    wrong = 0
    for turn in range(150):
        n = turn % 5
        content = read("pilots", f"{n}")
        wrong += content not in (None, bytes([n]) * 50_000)
        write("pilots", f"{n}", bytes([n]) * 50_000)
        if turn % 3 == 0:
            (disk_cache.folder_of("pilots") / f"{n}").unlink(missing_ok=True)
    answers.put((wrong, max(disk_cache._written.values())))


def test_processes_at_once_see_whole_files_or_none(root):
    fork = multiprocessing.get_context("fork")
    start, answers = fork.Barrier(4, timeout=60), fork.Queue()
    processes = [fork.Process(target=use, args=(start, answers), daemon=True) for _ in range(4)]
    for process in processes:
        process.start()
    assert [answers.get(timeout=120) for _ in processes] == [(0, 150)] * 4  # and no write failed
    for process in processes:
        process.join()
    assert {path.name for path in (root / "pilots").iterdir()} <= set("01234")


# Sources
def imports(file: Path) -> set[Path]:
    """Files of the package that a file imports, by the parser."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom):
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    stems = [ROOT.joinpath(*name.split(".")) for name in names if name and name.startswith("specklegen")]
    tried = [path for stem in stems for path in (stem.with_suffix(".py"), stem / "__init__.py")]
    return {path for path in tried if path.is_file()}


def reached(file: Path) -> set[Path]:
    """What a file imports, directly or not."""
    files, new = set(), {file}
    while new:
        files |= new
        new = {path for source in new for path in imports(source)} - files
    return files


@pytest.mark.parametrize("file", KERNELS, ids=lambda file: file.stem)
def test_sources_of_kernels_are_kernels(file):
    assert sources_of(file) == reached(file)
    assert sources_of(file) <= {*KERNELS, Path(disk_cache.__file__)}


def test_sources_of_results_are_files_that_are_imported_and_data():
    for name in ("paths/pilot.py", "samplers/stationary/sampler.py", "memory_effects/cached.py"):
        file = ROOT / "specklegen" / name
        assert {path for path in sources_of(file) if path.suffix == ".py"} == reached(file)
    data = {*(ROOT / "specklegen" / "data").iterdir()}
    assert data <= sources_of(ROOT / "specklegen" / "memory_effects" / "atlas.py")
    assert not data & sources_of(ROOT / "specklegen" / "kernels" / "walk.py")


def test_the_digest_follows_every_source_and_no_other_file(tmp_path, monkeypatch):
    fresnel = ROOT / "specklegen" / "kernels" / "fresnel.py"
    before = disk_cache.source_digest(fresnel)
    package = tmp_path / "specklegen"
    folder = shutil.copytree(fresnel.parent, package / "kernels")
    shutil.copy(disk_cache.__file__, package)
    monkeypatch.setattr(disk_cache, "PACKAGE", package)

    def digest() -> str:
        disk_cache._examined.cache_clear()
        return disk_cache.source_digest.__wrapped__(folder / fresnel.name)

    assert digest() == before
    for path in sorted(folder.glob("*.py")):
        with path.open("a") as source:
            source.write("# changed\n")
        after = digest()
        assert (after != before) == (path.name in {source.name for source in reached(fresnel)}), path.name
        before = after
    disk_cache._examined.cache_clear()
