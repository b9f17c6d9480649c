"""How fast images come, and how fast a network takes them: of an epoch, in its log and in words."""

import torch

from specklegen.models import Training, train
from specklegen.models.learning import run as run_of_training
from specklegen.models.learning.examples import Examples
from specklegen.models.learning.run import read_log
from specklegen.models.learning.targets import TARGETS


class Clock:
    """A clock that only those who work let go on."""

    def __init__(self):
        self.now = 0.0

    def perf_counter(self):
        return self.now

    def __getattr__(self, name):
        import time

        return getattr(time, name)


def test_the_log_says_how_fast_images_came_and_how_fast_they_were_trained_on(tmp_path, monkeypatch):
    clock = Clock()
    monkeypatch.setattr(run_of_training, "time", clock)

    def loss(logits, targets):
        clock.now += 0.5
        return (logits - targets).square().mean()

    def batches(_epoch, first):
        for _ in range(first, 3):
            clock.now += 2.0
            yield torch.randn(8, 9), torch.randn(8, 1, 4)

    batches.identity = {"of": "a test"}
    held_out = Examples(torch.randn(4, 9).half(), torch.randn(4, 1, 4), torch.arange(4))
    settings = Training(target="material", input="registered+power", network="perceptron", width=4, epochs=2)
    monkeypatch.setitem(TARGETS, "material", TARGETS["material"]._replace(loss=loss))
    train(settings, (batches, 3), held_out, tmp_path)
    rates = [(row["made_per_second"], row["trained_per_second"]) for row in read_log(tmp_path)]
    assert rates == [(4.0, 16.0)] * 2, "8 images in 2 s, and in half a second"
