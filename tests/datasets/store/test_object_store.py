"""Stores written at an address: the same bytes as in a folder, claims by puts, parts that know their own shards."""

import threading
import time
import warnings

import fuzz_addresses
import numpy as np
import pytest
from fake_recipe import FakeRecipe, assert_same
from small_stores import TIMEOUT, Forked, contents, make

from specklegen.cli.commands import app
from specklegen.core.errors import RuleError
from specklegen.datasets import SpeckleCache
from specklegen.datasets.store import creation, locks, places
from specklegen.datasets.store.creation import open_for
from specklegen.datasets.store.filling import GenerationError, fill_shard
from specklegen.datasets.store.info import info
from specklegen.datasets.store.store import Store
from specklegen.datasets.store.verify import verify

fsspec = pytest.importorskip("fsspec")
upath = pytest.importorskip("upath", reason="needs the extra remote")


@pytest.fixture
def address(request):
    system, name = fsspec.filesystem("memory"), f"/{request.node.originalname}/a.zarr"
    yield upath.UPath(f"memory:/{name}")
    if system.exists(folder := name.rsplit("/", 1)[0]):
        system.rm(folder, recursive=True)


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(locks, "LOOK", 0.01)


def objects(address):
    """Every object under an address but claims, by its path."""
    found = address.fs.find(address.path)
    start = len(address.path.rstrip("/")) + 1
    return {name[start:]: address.fs.cat_file(name) for name in found if "/claims/" not in name}


def claims(address):
    return [name for name in address.fs.find(address.path) if "/claims/" in name]


def test_a_store_at_an_address_has_the_bytes_of_one_in_a_folder(address, tmp_path):
    make(tmp_path / "a.zarr", samples=13)
    make(tmp_path / "a.zarr")
    make(address, samples=13)
    said = make(address)
    assert objects(address) == contents(tmp_path / "a.zarr")
    assert (said["done"], said["rendered"], said["bytes"]) == (22, 12, sum(map(len, objects(address).values())))
    assert claims(address) == []
    card = address.with_name("a.card.md").read_text()
    assert card == (tmp_path / "a.card.md").read_text()
    assert make(address)["rendered"] == 0


def test_one_that_stopped_is_gone_on_with_and_damage_is_mended(address):
    make(address, shard_range=(0, 2))
    assert make(address)["rendered"] == 22 - 10
    (shard,) = [name for name in address.fs.find(address.path) if "/image/c/1/" in name]
    data = bytearray(address.fs.cat_file(shard))
    data[3] ^= 1
    address.fs.pipe_file(shard, bytes(data))
    address.fs.rm(f"{address.path}/valid/record.json")
    assert verify(address, FakeRecipe()).damaged == (1,)
    assert verify(address).sound
    assert_same(SpeckleCache(address).numpy(6) | {"index": np.int64(6)}, FakeRecipe().sample(0, "train", 6))


def test_what_lies_there_already_is_refused(address):
    make(address)
    with pytest.raises(RuleError, match=r"seed \(0 there, 1 here\)"):
        make(address, seed=1)
    beside = address.with_name("b.zarr")
    beside.fs.pipe_file(f"{beside.path}/notes.txt", b"mine")
    with pytest.raises(RuleError, match="a folder that holds a store"):
        make(beside)
    assert objects(beside) == {"notes.txt": b"mine"}


def test_of_several_that_begin_one_store_one_does_and_all_fill_it(address, quick, tmp_path, monkeypatch):
    """The others begin between the looks of the first, and are slow at it."""
    system, log = type(address.fs), tmp_path / "log"
    recipe, said, find, put = FakeRecipe(seconds=0.002, log=str(log)), [], system.find, system.pipe_file
    first, *others = [threading.Thread(target=lambda: said.append(make(address, recipe))) for _ in range(3)]

    def listed_late(self, *arguments, **options):
        if threading.current_thread() is first and others[0].ident is None:
            for call in others:
                call.start()
            while not address.fs.exists(f"{address.path}/zarr.json"):
                time.sleep(0.001)
        return find(self, *arguments, **options)

    def put_slowly(self, path, *arguments, **options):
        put(self, path, *arguments, **options)
        time.sleep(0.02 * path.endswith("/zarr.json"))

    monkeypatch.setattr(system, "find", listed_late)
    monkeypatch.setattr(system, "pipe_file", put_slowly)
    first.start()
    for call in (first, *others):
        call.join(TIMEOUT)
    assert [each["done"] for each in said] == [22] * 3
    assert sum(each["rendered"] for each in said) == 22, "each shard by one of them"
    assert verify(address).sound
    assert claims(address) == []


def test_whoever_begins_another_data_set_there_meanwhile_is_refused(address, quick):
    """One has put the group, and nothing else yet."""
    make(address)
    whole = objects(address)
    for name in whole.keys() - {"zarr.json"}:
        address.fs.rm(f"{address.path}/{name}")
    late = threading.Timer(0.2, lambda: [address.fs.pipe_file(f"{address.path}/{n}", d) for n, d in whole.items()])
    late.start()
    with pytest.raises(RuleError, match=r"seed \(0 there, 3 here\)"):
        make(address, seed=3)
    late.join()


def test_whoever_finds_one_that_was_begun_and_left_puts_the_rest(address, quick, monkeypatch):
    monkeypatch.setattr(locks, "OLD", 0.05)
    make(address)
    places.put(address / "valid" / "claims" / "metadata", b"0 of whoever was killed")
    whole = objects(address)
    for name in whole.keys() - {"zarr.json"}:
        address.fs.rm(f"{address.path}/{name}")
    with pytest.raises(RuleError, match=r"seed \(0 there, 3 here\)"):
        make(address, seed=3)
    assert make(address)["rendered"] == 22
    assert objects(address) == whole


def test_another_begins_the_store_between_the_looks_of_this_one(address, quick, monkeypatch):
    """Its group appears before this one lists the folder, and the rest later: no other's folder, no damage."""
    make(address)
    whole = objects(address)
    address.fs.rm(address.path, recursive=True)
    listed, late = places.listed, []

    def between(folder, **options):
        if not late:
            address.fs.pipe_file(f"{address.path}/zarr.json", whole["zarr.json"])
            places.put(address / "valid" / "claims" / "metadata", f"{time.time()} of the other".encode())
            rest = [*whole.items(), ("valid/claims/metadata", None)]
            late.append(threading.Timer(0.3, lambda: [replaced(name, data) for name, data in rest]))
            late[0].start()
        return listed(folder, **options)

    def replaced(name, data):
        path = f"{address.path}/{name}"
        address.fs.rm(path) if data is None else address.fs.pipe_file(path, data)

    monkeypatch.setattr(creation, "listed", between)
    make(address)
    late[0].join()
    assert objects(address) == whole


@pytest.mark.parametrize(
    ("error", "words"),
    [(PermissionError("Access Denied"), "readable by you.*credentials of the address"),
     (type("NoCredentialsError", (Exception,), {})("Unable to locate credentials"), "an address with credentials"),
     (type("EndpointConnectionError", (Exception,), {})("Could not connect"), "can be reached.*network"),
     (ConnectionRefusedError(111, "refused"), "can be reached"),
     (type("ReadTimeoutError", (Exception,), {})("Read timeout"), "answers in time.*Try again"),
     (TimeoutError(110, "timed out"), "answers in time"), (OSError(5, "Input/output error"), "readable;.*try again"),
     (ImportError("Install s3fs to access S3"), "installed file system.*Install s3fs")],
)  # fmt: skip
def test_a_place_that_gives_no_answer_says_why(address, monkeypatch, error, words):
    make(address)

    def failing(*_, **__):
        raise error

    monkeypatch.setattr(type(address.fs), "cat_file", failing)
    for act in (SpeckleCache, make, verify, info):
        with pytest.raises(RuleError, match=words) as told:
            act(address)
        assert "damaged" not in str(told.value)


class Once:
    """An operation that fails once, after so many calls."""

    def __init__(self, act, error, after):
        self.act, self.error, self.after = act, error, after

    def __call__(self, *arguments, **options):
        self.after -= 1
        if self.after == -1:
            raise self.error("Could not connect")
        return self.act(*arguments, **options)


def read_all(place):
    return [SpeckleCache(place).numpy(n) for n in range(22)]


LOST = type("EndpointConnectionError", (Exception,), {})


@pytest.mark.parametrize(
    ("name", "error", "places"),
    [("pipe_file", LOST, (4, 14)), ("cat_file", LOST, (5, 40, 68)), ("cat_file", ConnectionRefusedError, (9, 40)),
     ("find", LOST, (0,)), ("rm_file", LOST, (2,))],
)  # fmt: skip
def test_a_network_that_fails_once_in_the_middle_is_told_and_nothing_is_lost(address, monkeypatch, name, error, places):
    system, told = type(address.fs), []

    def fails(act, after):
        once = Once(getattr(system, name), error, after)
        with monkeypatch.context() as patch:
            patch.setattr(system, name, lambda *words, **options: once(*words, **options))
            try:
                act(address)
            except (RuleError, GenerationError) as refusal:
                told.append(str(refusal))

    for after in places:
        fails(make, after)
        make(address)
        fails(verify, after)
        fails(read_all, after)
        assert verify(address).sound
        address.fs.rm(address.path, recursive=True)
    assert told
    assert not any("damaged" in words for words in told)


def test_verify_calls_no_shard_damaged_that_it_cannot_reach(address, monkeypatch):
    make(address)
    read = type(address.fs).cat_file

    def late(self, path, **options):
        if "/image/c/" in path:
            raise TimeoutError(110, "timed out")
        return read(self, path, **options)

    monkeypatch.setattr(type(address.fs), "cat_file", late)
    with pytest.raises(RuleError, match="answers in time"):
        verify(address)


def test_a_claim_of_a_dead_machine_whose_clock_was_ahead_ends_and_is_told(address, quick, monkeypatch, caplog):
    monkeypatch.setattr(locks, "OLD", 0.3)
    make(address, shard_range=(0, 2))
    places.put(address / "valid" / "claims" / "3", f"{time.time() + 86400:.3f} process 7 of elsewhere".encode())
    assert make(address)["rendered"] == 12
    assert "valid/claims/3, claimed by another process" in caplog.text
    assert "process 7 of elsewhere" in caplog.text
    assert claims(address) == []


def test_a_claim_keeps_others_away_until_it_ends_or_is_old(address, quick, monkeypatch):
    claim = address / "claim"
    with locks.claim_object(claim) as first:
        assert first == "held"
        with locks.claim_object(claim) as second:
            assert second == "busy"
        waited = []

        def wait():
            with locks.claim_object(claim, wait=True) as state:
                waited.append(state)

        other = threading.Thread(target=wait)
        other.start()
        time.sleep(0.1)
        assert waited == []
    other.join(TIMEOUT)
    assert waited == ["held"]
    assert not claim.exists()
    for left in (f"{time.time() - locks.OLD - 1}".encode(), b""):  # of whoever was killed
        places.put(claim, left)
        with locks.claim_object(claim) as state:
            assert state == "held"


def test_a_claim_is_dated_anew_while_the_work_goes_on(address, quick, monkeypatch):
    monkeypatch.setattr(locks, "BEAT", 0.02)
    monkeypatch.setattr(locks, "OLD", 0.5)
    claim = address / "claim"
    with locks.claim_object(claim):
        end = time.time() + 1.0
        while time.time() < end:
            with locks.claim_object(claim) as state:
                assert state == "busy"
            time.sleep(0.05)


def test_a_shard_that_fails_leaves_no_claim_and_a_full_ledger_elsewhere(address):
    recipe = FakeRecipe(fails_at=7)
    share = open_for(recipe, 0, "train", "uint16", address, 22, 5)
    assert share.missing == [*range(5)]
    assert [fill_shard(share.store, recipe, shard).state for shard in (0, 1)] == ["written", "failed"]
    assert claims(address) == []
    assert info(address)["done"] == 5


def test_processes_share_out_the_shards_of_an_address_and_a_kill_loses_nothing(tmp_path):
    from own_bucket import Bucket

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a protocol that universal-pathlib has no tests of
        place = upath.UPath(f"bucket://{tmp_path}/a.zarr")
    assert isinstance(place.fs, Bucket)
    said = [tmp_path / name for name in ("killed", "one", "other")]

    def start(answer):
        call = Forked(target=lambda: answer.write_text(str(make(place, slow, processes=1)["rendered"])))
        call.start()
        return call

    slow = FakeRecipe(seconds=0.02)
    killed = start(said[0])
    end = time.time() + TIMEOUT
    while not (tmp_path / "a.zarr/valid/record.json").exists() and time.time() < end:
        time.sleep(0.01)
    time.sleep(0.05)
    killed.kill()
    killed.wait(TIMEOUT)
    for claim in (tmp_path / "a.zarr/valid/claims").iterdir():
        claim.write_text(f"{time.time() - 2 * locks.OLD}")
    before = info(place)["done"]
    assert [call.wait(TIMEOUT) for call in [start(answer) for answer in said[1:]]] == [0, 0]
    assert sum(int(answer.read_text()) for answer in said[1:]) == 22 - before
    assert verify(place).sound
    make(tmp_path / "b.zarr")
    assert objects(place) == contents(tmp_path / "b.zarr")


def test_kills_of_those_who_begin_a_store(tmp_path):
    assert fuzz_addresses.run(6, fuzz_addresses.bucket(tmp_path), tmp_path)[1] >= 5


@pytest.mark.parametrize("where", ["folder", "address"])
def test_a_part_reads_the_ledger_of_its_own_shards_alone(where, address, tmp_path, monkeypatch):
    place = tmp_path / "a.zarr" if where == "folder" else address
    make(place, shard_range=(1, 2))
    read, walked = [], []
    ledger = Store.valid_in
    monkeypatch.setattr(
        Store, "valid_in", lambda self, shard, expected=False: (read.append(shard), ledger(self, shard, expected))[1]
    )
    monkeypatch.setattr("specklegen.datasets.store.info.stored_bytes", lambda folder: walked.append(folder) or 0)
    monkeypatch.setattr(Store, "temporaries", lambda self: walked.append(self) or ())
    said = make(place, shard_range=(0, 2))
    assert set(read) == {0, 1}
    assert walked == []
    assert (said["done"], said["total"], said["shards"], said["shards_done"]) == (10, 10, 2, 2)
    assert said["bytes"] > 1000
    whole = make(place)
    assert (whole["done"], whole["total"], whole["shards"]) == (22, 22, 5)
    assert set(read) == {0, 1, 2, 3, 4}
    assert len(walked) == 2, "this test would fail where a part looked through all"


def test_commands_take_an_address(address, tmp_path):
    from typer.testing import CliRunner

    def run(*words):
        done = CliRunner().invoke(app, [*map(str, words)])
        assert done.exit_code == 0, done.output
        return done.output

    few = ["--set", "material.kernel_paths=1000", "--samples", "4", "--out", address, "--processes", 1]
    assert "2 of 2 samples of part 0/2 in" in run("generate", "through-slab", *few, "--shard-range", "0/2")
    assert "rendered 2 in" in run("generate", "through-slab", *few)
    assert '"done": 4' in run("store", "info", address)
    assert run("store", "verify", address).startswith("4 shards: 4 sound")
    run("store", "export", address, "--out", tmp_path / "npy")
    assert np.load(tmp_path / "npy/image.npy").shape == (4, 128, 128)


@pytest.mark.slow
def test_a_server_of_the_s3_protocol_takes_and_gives_the_same_bytes(tmp_path):
    server_of = pytest.importorskip("moto.server").ThreadedMotoServer
    pytest.importorskip("s3fs")
    server = server_of(port=0)
    server.start()
    host, port = server.get_host_and_port()
    options = {"key": "any", "secret": "any", "endpoint_url": f"http://{host}:{port}"}
    try:
        fsspec.filesystem("s3", **options).mkdir("bucket")
        place = upath.UPath("s3://bucket/sets/a.zarr", **options)
        claim = place.parent / "claim"
        assert places.put_new(claim, b"1")
        assert not places.put_new(claim, b"2"), "a conditional put"
        make(place, samples=13, processes=2)
        make(place)
        make(tmp_path / "a.zarr", samples=13)
        make(tmp_path / "a.zarr")
        place.fs.invalidate_cache()
        assert objects(place) == contents(tmp_path / "a.zarr")
        assert verify(place).sound
        assert_same(SpeckleCache(place).numpy(6) | {"index": np.int64(6)}, FakeRecipe().sample(0, "train", 6))
    finally:
        server.stop()
