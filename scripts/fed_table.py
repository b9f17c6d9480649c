"""Images a second that recipes make against images a second that their networks train on, one core of either.

    python scripts/fed_table.py                            table, and docs/images/fed.png
    python scripts/fed_table.py --recipes unknown-slab --seconds 5

Of each recipe as `specklegen train` streams it: neighbouring samples share a medium where none is shown twice. Made are
batches of 32, their inputs included, in processor seconds of one thread, after 64 of them; trained is the default
network, forward and backward, on such inputs.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch

from specklegen.core.parallel import one_torch_thread
from specklegen.datasets import load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.models import Training
from specklegen.models.learning.examples import sharing_media
from specklegen.models.learning.inputs import network_input
from specklegen.models.learning.losses import loss_named
from specklegen.models.learning.networks import build
from specklegen.models.learning.targets import TARGETS

RECIPES = (
    "double-diffuser", "through-slab", "unknown-slab", "points-beyond-range", "any-object",
    "beyond-memory-effect",
)  # fmt: skip
BATCH, WARM = 32, 2


def rates(name: str, seconds: float) -> tuple[float, float]:
    """Images a second made, and trained on."""
    settings = Training()
    recipe = sharing_media(load_recipe(name))
    values, loss_of = TARGETS[settings.target].values, loss_named(settings.loss)

    def made(number: int) -> tuple[torch.Tensor, torch.Tensor]:
        batch = tensors(recipe.batch(0, "train", range(BATCH * number, BATCH * (number + 1))))
        return network_input(batch, settings.input), values(batch)

    for number in range(WARM):
        inputs, targets = made(number)
    network = build(settings.network, inputs.shape[-1], tuple(targets.shape[-2:]), settings.width, 0)
    optimiser = torch.optim.AdamW(network.parameters())

    def trained(_number: int) -> None:
        loss = loss_of(network(inputs).float(), targets)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()

    trained(0)
    return _rate(made, seconds), _rate(trained, seconds)


def _rate(act, seconds: float) -> float:
    begin, count = time.process_time(), 0
    while time.process_time() - begin < seconds:
        act(WARM + count)
        count += 1
    return BATCH * count / (time.process_time() - begin)


def picture(found: dict[str, tuple[float, float]], out: Path) -> None:
    """Bars of both, a recipe each."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 0.5 * len(found) + 1.2), layout="constrained")
    axes, places = figure.subplots(), np.arange(len(found))
    for shift, column, label in ((-0.2, 0, "made, one core"), (0.2, 1, "trained on, one core")):
        axes.barh(places + shift, [pair[column] for pair in found.values()], 0.38, label=label)
    axes.set_yticks(places, list(found))
    axes.invert_yaxis()
    axes.set_xscale("log")
    ticks = [10, 30, 100, 300, 1000]
    axes.set_xticks(ticks, [str(n) for n in ticks])
    axes.minorticks_off()
    axes.set_xlabel("images a second")
    figure.legend(loc="outside upper right", ncols=2, frameon=False)
    figure.savefig(out, dpi=110)


def main() -> None:
    """Print the table and draw the picture."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--recipes", nargs="+", default=RECIPES)
    arguments.add_argument("--seconds", type=float, default=10.0, help="of either, a recipe")
    arguments.add_argument("--out", type=Path, default=Path("docs/images/fed.png"))
    asked = arguments.parse_args()
    torch.set_num_threads(1)
    found = {}
    print("| recipe | made, images a second | trained on | cores that keep one core of training fed |")
    print("|---|---|---|---|")
    with one_torch_thread():
        for name in asked.recipes:
            made, trained = found[name] = rates(name, asked.seconds)
            print(f"| {name} | {made:.0f} | {trained:.0f} | {trained / made:.1f} |", flush=True)
    picture(found, asked.out)


if __name__ == "__main__":
    main()
