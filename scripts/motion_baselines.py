"""What networks and closed forms tell of media that move and that nobody has seen: the tables of docs/motion.md.

    python scripts/motion_baselines.py motion --seeds 3          # lsci-slab: log10 tau0, share at rest
    python scripts/motion_baselines.py contrast                  # flow-vessel: maps of contrast

Training, validation and test are media of their own; every run has a seed that decides its media and its first weights.
"""

import argparse
import tempfile
import time

from specklegen.datasets import load_recipe
from specklegen.models import Training, train
from specklegen.models.judging.answers import judge
from specklegen.models.judging.closed_contrast import closed_contrast
from specklegen.models.judging.closed_inversion import closed_inversion
from specklegen.models.judging.contrast_maps import judge_maps
from specklegen.models.learning.examples import batches_of, examples
from specklegen.models.learning.networks import parameter_count

RUNS = {
    "motion": ("lsci-slab", {"input": "exposures", "network": "perceptron", "width": 4, "epochs": 60},
               (1024, 128, 256)),
    "contrast": ("flow-vessel", {"input": "local-contrast", "network": "contrast", "width": 8, "epochs": 60,
                                 "batch_size": 16, "patience": 60}, (512, 64, 128)),
}  # fmt: skip
"""Recipe, training, and stacks of training, validation and test."""


def measured(target: str, seed: int, counts: tuple[int, int, int]) -> None:
    """Train once and print the table of the test."""
    name, settings, _ = RUNS[target]
    recipe, started = load_recipe(name), time.process_time()
    trained, held = (
        examples(recipe, settings["input"], count, seed, split, target)
        for count, split in zip(counts, ("train", "validation"), strict=False)
    )
    drawn = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        model = train(Training(target=target, seed=seed, **settings), trained, held, folder)
    learned = time.process_time()
    if target == "motion":
        beside = {"closed inversion": closed_inversion(recipe, seed)}
    else:
        beside = closed_contrast(recipe, seed)
    batches = batches_of(recipe, counts[2], seed, "test")
    found = (judge if target == "motion" else judge_maps)(model, batches, beside)
    print(f"seed {seed}, {parameter_count(model.network)} parameters; processor seconds: media and stacks "
          f"{drawn - started:.0f}, training {learned - drawn:.0f}")  # fmt: skip
    print(found.markdown(), flush=True)


def main() -> None:
    """Read the command line."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("target", choices=RUNS)
    asked.add_argument("--seeds", type=int, default=1)
    asked.add_argument("--samples", type=int, nargs=3, help="of training, validation and test")
    given = asked.parse_args()
    for seed in range(given.seeds):
        measured(given.target, seed, tuple(given.samples or RUNS[given.target][2]))


if __name__ == "__main__":
    main()
