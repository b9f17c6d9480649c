"""The model in the package: small, described, and better than knowing nothing, on slabs that it has never seen."""

import numpy as np
import torch
from zscore import limit

from specklegen.datasets import load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.models.judging.baselines import mean_image
from specklegen.models.judging.evaluation import evaluate
from specklegen.models.learning.reconstructor import PRETRAINED, load_pretrained


def test_uneven_light_of_a_bench_does_not_harm_a_network():
    """Paired over 64 media, characters that neither network has seen; without a taper .61 and .73 of .82 and .82."""
    of = {"objects": {"disjoint": "character", "test": "569FMVTWt", "validation": "2KPbqB"}}

    def scores(bench):
        batch = tensors(load_recipe("unknown-slab", of | {"bench": bench}).batch(11, "test", range(64)))
        methods = {name: load_pretrained(name=name).reconstruct for name in PRETRAINED}
        found, _ = evaluate(methods, [batch])
        return np.array([found.values[name]["sharp"]["pearson"] for name in PRETRAINED])

    uneven, even = scores({"gradient": 0.8, "stray": 0.2}), scores({})
    assert (uneven.mean(1) > even.mean(1) - 0.07).all()
    assert (even.mean(1) > 0.8).all()


def test_it_sees_more_than_the_mean_image():
    """Paired over 24 media of a seed that no table used; and the power of that: shuffled answers fail."""
    recipe = load_recipe("unknown-slab", {"objects": {"disjoint": "character"}})
    batch = tensors(recipe.batch(7, "test", range(24)))
    objects = torch.stack([torch.from_numpy(recipe.objects.image(0, "train", n)) for n in range(64)])
    made = load_pretrained().reconstruct(batch)
    methods = {"mean": mean_image(objects), "net": lambda _: made, "shuffled": lambda _: made.roll(1, 0)}
    found, _ = evaluate(methods, [batch])
    scores = {name: values["sharp"]["pearson"] for name, values in found.values.items()}

    def z(name):
        gain = scores[name] - scores["mean"]
        return gain.mean() / (gain.std(ddof=1) / np.sqrt(len(gain)))

    bound = limit(degrees=23)
    assert z("net") > bound
    assert z("shuffled") < bound
