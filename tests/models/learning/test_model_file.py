"""The file of a model: whole or refused, and never larger in memory than on the disk."""

import json

import numpy as np
import pytest
import torch
from refusals import assert_refused

from specklegen.core.errors import RuleError
from specklegen.models.learning.model_file import read_model, restored, write_model
from specklegen.models.learning.networks import build
from specklegen.models.learning.reconstructor import Reconstructor

WIDTH = 1


@pytest.fixture(scope="module")
def model_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "best.pt"
    network = build("dense", 64, (28, 28), WIDTH, seed=0)
    Reconstructor(network, "dense", "autocorrelation", WIDTH, 64, (28, 28)).save(path)
    return path


def test_what_was_written_is_read(model_file, tmp_path):
    there = Reconstructor.load(model_file).network.state_dict()
    made = build("dense", 64, (28, 28), WIDTH, seed=0).state_dict()
    assert all(torch.equal(there[key], value) for key, value in made.items())
    numbers = {"a": torch.arange(6.0).reshape(2, 3), "b": torch.tensor([1, -2], dtype=torch.int8), "c": torch.zeros(0)}
    write_model(tmp_path / "numbers", {"name": "x"}, numbers)
    stated, read = read_model(tmp_path / "numbers")
    assert stated == {"name": "x"}
    assert all(torch.equal(read[key], value) for key, value in numbers.items())


def test_no_flipped_bit_goes_unseen(model_file, tmp_path):
    content = model_file.read_bytes()
    header = int.from_bytes(content[:8], "little") + 8
    rng = np.random.default_rng(0)
    places = [*range(8), *rng.integers(0, header, 60).tolist(), *rng.integers(header, len(content), 60).tolist()]
    for place in places:
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(rng.integers(8))
        (tmp_path / "flipped.pt").write_bytes(damaged)
        with pytest.raises(RuleError, match="model must be"):
            Reconstructor.load(tmp_path / "flipped.pt")


@pytest.mark.parametrize("length", [0, 7, 8, 100, 10_000])
def test_a_file_cut_short_is_refused(model_file, tmp_path, length):
    (tmp_path / "short.pt").write_bytes(model_file.read_bytes()[:length])
    assert_refused(lambda: Reconstructor.load(tmp_path / "short.pt"), "model must be")


@pytest.mark.parametrize("stated", [{"width": 10**6}, {"width": 10**12}, {"width": -1}, {"width": 1.5}, {"side": 10**9},
                                    {"name": "nothing"}, {"input": "nothing"}, {"shape": [10**6, 10**6]}, {"shape": 7},
                                    {"shape": [1]}], ids=str)  # fmt: skip
def test_a_header_that_promises_more_than_the_file_holds_is_refused(model_file, tmp_path, stated):
    """Before anything of that size is asked for: 10**12 channels would take terabytes."""
    true, weights = read_model(model_file)
    write_model(tmp_path / "giant.pt", true | stated, weights)
    with pytest.raises(RuleError, match="model must be a file with weights|model network must be one of"):
        Reconstructor.load(tmp_path / "giant.pt")


def test_a_pickle_is_refused_without_being_opened(tmp_path):
    torch.save({"model": json.dumps({}), "weights": {}}, tmp_path / "pickle.pt")
    assert_refused(lambda: Reconstructor.load(tmp_path / "pickle.pt"), r"Reconstructor\.save")


@pytest.mark.parametrize("kept", [
    {"a": torch.tensor([1.0, float("nan")])},
    {"a": torch.ones(2, 2, dtype=torch.int8), "a:scale": torch.tensor([1.0, float("inf")])},
])  # fmt: skip
def test_weights_that_are_not_finite_are_refused(kept):
    assert_refused(lambda: restored(kept), "model must be a file of finite weights")
