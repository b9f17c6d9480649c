"""Training on one page: batches -> network -> loss -> step, with a line of a log after each epoch.

Everything random is a function of (seed, epoch, step): first weights, order of the samples, mirroring. So a run is
repeated by its settings, and one that was stopped goes on to the same bits. The one exception is a budget in seconds:
there the learning rate falls with the time spent, so that a run ends well whenever it ends.

Files in the folder of a run: ``run.json`` (settings and data; nothing else goes on with the run), ``checkpoint.pt``
(all that is needed to go on: after each epoch, every few minutes, and on Ctrl-C), ``best.pt`` (the model with the best
Pearson correlation on validation media), ``log.csv``.
"""

import csv
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import torch
from pydantic import model_validator
from torch import Tensor, nn

from specklegen.core.errors import reject
from specklegen.core.values import NonNegative, Positive, PositiveInt, Value
from specklegen.models.learning.examples import Examples, mirrored
from specklegen.models.learning.interrupts import deferred
from specklegen.models.learning.losses import Loss, loss_named
from specklegen.models.learning.networks import build
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.learning.run_record import record, require_same_run, write_record
from specklegen.models.metrics import align, pearson

WARM_UP = 50
"""Steps over which the learning rate rises from 0."""
_CHUNK = 256  # samples at once where no gradient is kept


class Training(Value):
    """What decides a network, given its data.

    Parameters
    ----------
    input
        What the network sees: "autocorrelation" or "camera".
    network
        "residual" (for autocorrelations), "unet", "stack-unet" (for recipes with several images a sample) or "dense".
    width
        Channels at the top of the U-Net, or a sixteenth of the units of the other two.
    loss
        A name in :data:`specklegen.models.learning.losses.LOSSES`.
    learning_rate
        Largest, of AdamW; it rises over 50 steps, then falls to 0 along a cosine.
    weight_decay
        Of AdamW.
    batch_size
        Samples a step.
    epochs
        Passes through the data, or through an epoch's length of a stream.
    patience
        Epochs without a better validation after which to stop.
    mirror
        Show half of the samples mirrored; only for square images without a left and right of their own.
    seed
        Of first weights, order and mirroring.
    """

    input: Literal["autocorrelation", "camera"] = "autocorrelation"
    network: Literal["residual", "unet", "stack-unet", "dense"] = "unet"
    width: PositiveInt = 16
    loss: str = "pearson-invariant"
    learning_rate: Positive = 3e-3
    weight_decay: NonNegative = 0.01
    batch_size: PositiveInt = 64
    epochs: PositiveInt = 20
    patience: PositiveInt = 10
    mirror: bool = False
    seed: int = 0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.network == "residual" and self.input != "autocorrelation":
            reject("Training.input", '"autocorrelation" for the residual net', self.input, "Or train another.")
        return self


Batches = Callable[[int, int], Iterator[tuple[Tensor, Tensor]]]
"""Function of (epoch, first step) to batches of (inputs, targets)."""


def shuffled(examples: Examples, training: Training) -> Batches:
    """Batches of stored examples, in an order that is a function of (seed, epoch)."""

    def batches(epoch: int, first: int) -> Iterator[tuple[Tensor, Tensor]]:
        rng = np.random.default_rng(np.random.SeedSequence([training.seed, epoch]))
        order = torch.from_numpy(rng.permutation(len(examples.targets)))
        for places in order.split(training.batch_size)[first:]:
            yield examples.inputs[places].float(), examples.targets[places]

    return batches


def train(
    training: Training,
    data: Examples | tuple[Batches, int],
    validation: Examples,
    folder: str | os.PathLike,
    *,
    seconds: float | None = None,
    device: str = "cpu",
    progress: Callable[[dict[str, float]], None] | None = None,
    steps: Callable[[int, int], None] | None = None,
    about: Mapping[str, Any] | None = None,
    save_every: float = 300.0,
    stop_after: int | None = None,
) -> Reconstructor:
    """Train a network, or go on where the run in this folder was stopped.

    A finished run goes on if more epochs, or more seconds, are asked for; the learning rate is then that of the
    longer run.

    Parameters
    ----------
    training
        Settings.
    data
        Examples in memory, or (a function of (epoch, first step) to batches, batches in an epoch) for a stream.
    validation
        Examples of other media and objects.
    folder
        Of the run.
    seconds
        Processor time to spend, all threads together (on a CUDA device: time by the clock). None: all epochs.
    device
        Torch device. On CUDA the forward pass runs in bfloat16, which the CPU would only emulate.
    progress
        Called with each row of the log.
    steps
        Called with (steps done, steps in all epochs) after every step.
    about
        What "data" and "validation" are, as tables of JSON: recorded with the run, and named where another run differs.
    save_every
        Seconds between checkpoints inside an epoch.
    stop_after
        Steps after which to stop, as if interrupted; the checkpoint is exact.

    Returns
    -------
    Reconstructor
        The best on validation.

    Raises
    ------
    RuleError
        If the folder holds a run with other settings or data (more epochs are no difference), if the validation
        examples are the training examples, or there are none.
    KeyboardInterrupt
        On Ctrl-C, after the step that was being made and a checkpoint.
    """
    here = record(training, data if isinstance(data, Examples) else data[0], validation, about)
    if isinstance(data, Examples):
        data = shuffled(data, training), math.ceil(len(data.targets) / training.batch_size)
    batches, length = data
    if not length or not len(validation.targets):
        reject("train examples", "at least one, and one for validation", (length, len(validation.targets)))
    run = _Run(training, validation, Path(folder), device, here)
    run.finished |= seconds is not None and run.spent >= seconds
    clock = time.process_time if torch.device(device).type == "cpu" else time.perf_counter
    loss_of = loss_named(training.loss)
    taken, total, saved = 0, length * training.epochs, time.monotonic()
    with deferred() as interrupt:
        while not run.finished:
            try:
                for inputs, targets in batches(run.epoch, run.step):
                    begin = clock()
                    done = run.epoch * length + run.step
                    share = done / total if seconds is None else max(done / total, run.spent / seconds)
                    run.take_step(inputs, targets, loss_of, min(1.0, (done + 1) / WARM_UP) * cosine(share))
                    taken += 1
                    run.spent += clock() - begin
                    if steps is not None:
                        steps(done + 1, total)
                    if taken == stop_after:
                        run.save()
                        return run.reconstructor()
                    interrupt.obey()
                    if time.monotonic() - saved > save_every:
                        run.save()
                        saved = time.monotonic()
                    if seconds is not None and run.spent >= seconds:
                        run.finished = True
                        break
                interrupt.obey()
            except Exception:
                interrupt.obey()  # workers that heard the Ctrl-C too are gone
                raise
            except KeyboardInterrupt:
                if interrupt.asked:  # between two steps
                    run.save()
                raise
            row = run.end_epoch()
            saved = time.monotonic()
            if progress is not None:
                progress(row)
            interrupt.obey()
    return Reconstructor.load(run.folder / "best.pt")


def cosine(share: float) -> float:
    """Fall from 1 to 0 along half a cosine."""
    return 0.5 + 0.5 * math.cos(math.pi * min(share, 1.0))


class _Run:
    """State of a run; all of it is in the checkpoint."""

    def __init__(
        self, training: Training, validation: Examples, folder: Path, device: str, record: dict[str, Any]
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.record = record
        self.training, self.validation, self.folder, self.device = training, validation, folder, torch.device(device)
        side, shape = validation.inputs.shape[-1], (validation.targets.shape[-2], validation.targets.shape[-1])
        self.side, self.shape = side, shape
        network = build(training.network, side, shape, training.width, training.seed)
        self.network: nn.Module = network.to(self.device)
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), training.learning_rate, weight_decay=training.weight_decay
        )
        self.epoch = self.step = self.stale = 0
        self.spent = self.summed = 0.0
        self.best = -math.inf
        self.finished = False
        self.rows: list[dict[str, float]] = []
        if (folder / "checkpoint.pt").exists():
            self.restore()
        write_record(folder, record)

    def take_step(self, inputs: Tensor, targets: Tensor, loss_of: Loss, rate: float) -> None:
        """One step of the optimiser at a share of the learning rate."""
        training = self.training
        for group in self.optimiser.param_groups:
            group["lr"] = training.learning_rate * rate
        if training.mirror:
            rng = np.random.default_rng(np.random.SeedSequence([training.seed, self.epoch, self.step]))
            inputs, targets = mirrored(inputs, targets, torch.from_numpy(rng.random(len(targets)) < 0.5))
        self.network.train()
        inputs, targets = inputs.to(self.device), targets.to(self.device)
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.device.type == "cuda"):
            logits = self.network(inputs)
        loss = loss_of(logits.float(), targets)
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()
        self.step += 1
        self.summed += loss.item()

    def end_epoch(self) -> dict[str, float]:
        """Validate, log, keep the best, save."""
        model = self.reconstructor()
        found = validated(model, self.validation)
        row = {
            "epoch": self.epoch,
            "seconds": round(self.spent, 3),
            "train_loss": self.summed / max(self.step, 1),
            "validation_pearson": found,
            "learning_rate": self.optimiser.param_groups[0]["lr"],
        }
        self.rows.append(row)
        self.stale = 0 if found > self.best else self.stale + 1
        if found > self.best:
            self.best = found
            model.save(self.folder / "best.pt")
        self.epoch, self.step, self.summed = self.epoch + 1, 0, 0.0
        self.finished |= self.epoch >= self.training.epochs or self.stale >= self.training.patience
        self.save()
        with (self.folder / "log.csv").open("w", newline="") as file:
            table = csv.DictWriter(file, list(row))
            table.writeheader()
            table.writerows(self.rows)
        return row

    def reconstructor(self) -> Reconstructor:
        """The network as it is, ready to be used."""
        training = self.training
        return Reconstructor(
            self.network, training.network, training.input, training.width, self.side, self.shape, self.device
        )

    _COUNTERS = ("epoch", "step", "stale", "spent", "summed", "best", "finished", "rows")

    def save(self) -> None:
        """Write the checkpoint whole, or not at all."""
        state: dict[str, Any] = {name: getattr(self, name) for name in self._COUNTERS}
        state |= {"record": json.dumps(self.record), "side": self.side, "shape": list(self.shape)}
        state |= {"network": self.network.state_dict(), "optimiser": self.optimiser.state_dict()}
        partial = self.folder / "checkpoint.pt.partial"
        torch.save(state, partial)
        os.replace(partial, self.folder / "checkpoint.pt")

    def restore(self) -> None:
        """Take up the run of the folder."""
        state = torch.load(self.folder / "checkpoint.pt", map_location=self.device, weights_only=True)
        if "record" not in state:
            reject("train.folder", "that of a run that says what it was made with", str(self.folder),
                   "This one is of an older version. Choose another folder.")  # fmt: skip
        require_same_run(self.folder, json.loads(state["record"]), self.record)
        self.network.load_state_dict(state["network"])
        self.optimiser.load_state_dict(state["optimiser"])
        for name in self._COUNTERS:
            setattr(self, name, state[name])
        self.finished = self.epoch >= self.training.epochs or self.stale >= self.training.patience


def validated(model: Reconstructor, examples: Examples) -> float:
    """Mean Pearson correlation after alignment."""
    found = [
        pearson(align(made, targets), targets)
        for inputs, targets in zip(examples.inputs.split(_CHUNK), examples.targets.split(_CHUNK), strict=True)
        for made in [model(inputs.float()).cpu()]
    ]
    return float(torch.cat(found).mean())
