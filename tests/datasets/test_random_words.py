"""Words, keys and uniform numbers of a batch: the bits of NumPy's generators and of the engine's."""

import numpy as np
import pytest
import torch

from specklegen.core.random_streams import Stream, stream_key
from specklegen.datasets import random_words as words
from specklegen.datasets.split import SPLITS, Purpose, generator, substream
from specklegen.kernels.rng import philox as engine_philox
from specklegen.synthesis.gaussian_noise import philox

NUMBERS = [0, 1, 77, 2**32 - 1, 2**32, 2**40 + 3, 2**62 + 1]


@pytest.mark.parametrize("seed", [0, 5, 2**31, 2**32 + 7, 2**70 + 1])
@pytest.mark.parametrize("split", [0, 2])
def test_substreams_draw_numpys_numbers(seed, split):
    purposes = [Purpose.MATERIAL, Purpose.OBJECT, Purpose.FIELD, Purpose.READ_NOISE]
    tail = substream(seed, SPLITS[split], Purpose.MATERIAL, 0)[4:]
    found = words.substreams(split, [int(p) for p in purposes], NUMBERS, tail)
    drawn = words.uniforms(found)
    keys = words.stream_keys(words.keyed(Stream.STATIONARY, found))
    for i, number in enumerate(NUMBERS):
        for j, purpose in enumerate(purposes):
            expected = substream(seed, SPLITS[split], purpose, number)
            assert tuple(found[i, j].tolist()) == expected
            np.testing.assert_array_equal(drawn[i, j].numpy(), generator(expected).random(4))
            assert tuple(keys[i, j].tolist()) == stream_key(expected, Stream.STATIONARY)


@pytest.mark.parametrize("length", [4, 5, 9, 17])
def test_states_are_those_of_seed_sequences(length):
    entropy = np.random.default_rng(length).integers(0, 2**32, (50, length))
    entropy[0] = 0
    found = words.seed_state(torch.from_numpy(entropy), 4).numpy()
    expected = [np.random.SeedSequence(row.tolist()).generate_state(4) for row in entropy]
    np.testing.assert_array_equal(found, expected)


def test_blocks_are_those_of_the_engine():
    rng = np.random.default_rng(0)
    blocks = np.concatenate([rng.integers(0, 2**62, 100), [0, 2**32 - 1, 2**32]])
    for key in ((0, 0), (0xFFFFFFFF, 0x12345678)):
        found = torch.stack(philox(torch.tensor(key), torch.from_numpy(blocks)), -1).numpy()
        counters = np.stack([0 * blocks, blocks & 0xFFFFFFFF, blocks >> 32, 0 * blocks], -1).astype(np.uint32)
        expected = [engine_philox(*map(np.uint64, (*key, *counter))) for counter in counters]
        np.testing.assert_array_equal(found, expected)
