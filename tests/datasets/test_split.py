import itertools

import numpy as np
import pytest
from refusals import assert_refused
from scipy.stats import chi2, norm

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.datasets.split import (
    SHARES,
    SPLITS,
    Purpose,
    generator,
    keys_of_split,
    medium_of,
    position_in_pass,
    positions_in_passes,
    split_of,
    stable_hash,
    substream,
)

FALSE_ALARM = 1e-6  # chance that a right build fails, per test


def assert_uncorrelated(draws):
    """Largest |correlation| of the rows float[n, m] of independent normals, by Fisher's z."""
    correlations = np.corrcoef(draws)[np.triu_indices(len(draws), 1)]
    z = np.arctanh(correlations) * np.sqrt(draws.shape[1] - 3)
    limit = norm.isf(FALSE_ALARM / (2 * z.size))
    assert np.abs(z).max() < limit, f"z = {np.abs(z).max():.2f}, limit {limit:.2f}"


def test_substreams_of_different_addresses_differ_and_are_uncorrelated():
    addresses = list(itertools.product([0, 1, (0, 0), (1, 0)], SPLITS, list(Purpose)[:4], [0, 1]))
    words = [substream(*address) for address in addresses]
    assert len(set(words)) == len(words)
    assert_uncorrelated(np.array([generator(w).standard_normal(4000) for w in words]))


def test_the_correlation_test_has_power():
    draws = np.random.default_rng(0).standard_normal((20, 4000))
    draws[3] += 0.15 * draws[7]
    with pytest.raises(AssertionError, match="z ="):
        assert_uncorrelated(draws)


def test_no_two_seeds_share_words_even_where_seedsequence_pads_with_zeros():
    """SeedSequence treats (1,), (1, 0) and (1, 0, 0) alike, and splits 2**32 into (0, 1)."""
    seeds = [0, 1, (0, 0), (0, 0, 0), (1, 0), (1, 0, 0), (0, 1), 2**32, (2**32, 0), (0, 2**32), 2**64]
    states = [
        tuple(np.random.SeedSequence(substream(seed, "train", Purpose.MEDIUM, number)).generate_state(4))
        for seed in seeds
        for number in (0, 1, 2**32, 2**64 - 1)
    ]
    assert len(set(states)) == len(states)


def test_substream_is_stable_words_of_32_bits():
    """Golden: a change here changes every data set, and needs a new data version."""
    assert substream(7, "test", Purpose.READ_NOISE, 2**32 + 5) == (2, 13, 5, 1, 1, 1, 7)
    assert substream((3, 2**40), "train", Purpose.MATERIAL, 0) == (0, 1, 0, 0, 2, 1, 3, 2, 0, 256)
    assert substream(np.int64(7), "test", Purpose.READ_NOISE, np.int64(5)) == (2, 13, 5, 0, 1, 1, 7)
    assert stable_hash("specklegen") == 0xB9FAF8AD52E49C1A


@pytest.mark.parametrize(("arguments", "message"), [
    ((-1, "train", Purpose.MEDIUM, 0), "seed must be a whole number of at least 0"),
    ((1.5, "train", Purpose.MEDIUM, 0), "seed must be a whole number"),
    (((), "train", Purpose.MEDIUM, 0), "seed must be a whole number"),
    ((True, "train", Purpose.MEDIUM, 0), "seed must be a whole number"),
    ((0, "val", Purpose.MEDIUM, 0), "split must be one of 'train', 'validation', 'test'; got 'val'"),
    ((0, "train", Purpose.MEDIUM, -1), "number must be a whole number from 0"),
    ((0, "train", Purpose.MEDIUM, 2**64), "number must be a whole number from 0"),
])  # fmt: skip
def test_bad_addresses_are_refused(arguments, message):
    assert_refused(lambda: substream(*arguments), message)


def test_medium_of_counts_round_and_refuses_nonsense():
    assert [medium_of(n, 3) for n in range(7)] == [0, 1, 2, 0, 1, 2, 0]
    assert_refused(lambda: medium_of(0, 0), "media must be")
    assert_refused(lambda: medium_of(-1, 3), "index must be")


@pytest.mark.parametrize("count", [1, 2, 3, 4, 10, 18, 19, 945])
def test_listed_keys_are_dealt_to_disjoint_splits_that_cover_them(count):
    keys = [f"source {n}" for n in range(count)]
    parts = {split: keys_of_split(keys, split) for split in SPLITS}
    assert sorted(key for part in parts.values() for key in part) == sorted(keys)  # disjoint and complete
    if count > 2:
        assert all(len(parts[split]) >= 1 for split in SPLITS)
        assert all(abs(len(parts[s]) - SHARES[s] * count) <= 1.5 for s in SPLITS)
    else:
        assert len(parts["train"]) == count


def test_order_and_repetition_of_the_list_do_not_matter():
    keys = [f"source {n}" for n in range(50)]
    for split in SPLITS:
        assert keys_of_split(keys, split) == keys_of_split(keys[::-1] + keys[:7], split)


def test_a_new_key_moves_only_keys_beside_the_cuts():
    keys = [f"source {n}" for n in range(200)]
    before = {key: split for split in SPLITS for key in keys_of_split(keys, split)}
    after = {key: split for split in SPLITS for key in keys_of_split([*keys, "one more"], split)}
    assert sum(before[key] != after[key] for key in keys) <= 2


def assert_shares(counts):
    """Counts float[3] of the splits against `SHARES`, by chi squared."""
    expected = np.array([SHARES[split] for split in SPLITS]) * sum(counts)
    statistic = (np.square(counts - expected) / expected).sum()
    assert statistic < chi2.isf(FALSE_ALARM, 2), f"chi2 = {statistic:.1f}"


def test_hashed_sources_fall_into_the_splits_by_their_shares():
    splits = [split_of(f"pattern/{n}") for n in range(20_000)]
    assert_shares(np.array([splits.count(split) for split in SPLITS]))


def test_the_share_test_has_power():
    with pytest.raises(AssertionError, match="chi2"):
        assert_shares(np.array([16_000 - 300, 2_000 + 300, 2_000]))


def test_positions_of_many_samples_are_those_of_each():
    indices = [0, 16, 17, 3, 40, 2**40 + 5, 2**63 - 1, 3]
    found = positions_in_passes([3, 1], "test", indices, 17)
    assert found.tolist() == [position_in_pass([3, 1], "test", n, 17) for n in indices]
    assert found.tolist() != [position_in_pass([3, 2], "test", n, 17) for n in indices]  # power


def test_a_pass_shows_every_source_once_and_passes_differ():
    passes = [[position_in_pass(0, "train", 17 * p + n, 17) for n in range(17)] for p in range(3)]
    assert all(sorted(order) == list(range(17)) for order in passes)
    assert passes[0] != passes[1] != passes[2]
    assert passes[0] != [position_in_pass(1, "train", n, 17) for n in range(17)]
    assert passes[0] == [position_in_pass([0], "train", n, 17) for n in range(17)]


@pytest.mark.parametrize("wrong", [1.0, True, (1.0,), "1", np.array(1), []])
def test_what_only_equals_a_seed_is_refused_and_leaves_nothing_behind(wrong):
    """1.0 and 1 are one key of a dictionary: a generator that was kept for either would serve, or refuse, the other."""
    recipe = load_recipe("ground-glass", {"camera": {"shape": [16, 16]}})
    for _ in range(2):
        with pytest.raises(RuleError, match="seed"):
            recipe.sample(wrong, "train", 0)
        right = [recipe.sample(seed, "train", 0)["image"] for seed in (1, np.int64(1), (1,), [1])]
        assert all(np.array_equal(image, right[0]) for image in right)


@pytest.mark.parametrize("wrong", [0.7, 0.0, "0", None])
def test_numbers_of_samples_are_whole(wrong):
    with pytest.raises(RuleError, match="indices"):
        load_recipe("ground-glass", {"camera": {"shape": [16, 16]}}).batch(0, "train", [wrong])
