"""The state of a run: network, optimiser and counters, all of it in a checkpoint from which it goes on."""

import csv
import io
import json
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from specklegen.core.errors import reject
from specklegen.core.shielded import plain_defaults
from specklegen.core.whole_files import write_whole
from specklegen.models.learning.examples import Examples, mirrored
from specklegen.models.learning.losses import Loss
from specklegen.models.learning.networks import build
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.learning.run_record import require_same_run, write_record
from specklegen.models.learning.settings import Training
from specklegen.models.learning.targets import TARGETS

_CHUNK = 256  # samples at once where no gradient is kept


@dataclass
class Pace:
    """Rates of images made and trained, since an epoch began or the run was resumed.

    Attributes
    ----------
    waited, stepped : float
        Seconds by the clock until batches were there, and of the network's steps.
    """

    images: int = 0
    waited: float = 0.0
    stepped: float = 0.0

    def timed(self, batches: Iterator[tuple[Tensor, Tensor]]) -> Iterator[tuple[Tensor, Tensor]]:
        """Count the seconds until each batch is there."""
        begun = time.perf_counter()
        for batch in batches:
            self.waited += time.perf_counter() - begun
            yield batch
            begun = time.perf_counter()

    def rates(self) -> dict[str, float]:
        """Images a second that the data gave, and that the network trained on.

        Where workers make images beside the network, it waits for less than making them takes.
        """
        made, trained = (round(self.images / max(seconds, 1e-6), 1) for seconds in (self.waited, self.stepped))
        return {"made_per_second": made, "trained_per_second": trained}


class Run:
    """State of a run; all of it is in the checkpoint."""

    def __init__(
        self, training: Training, validation: Examples, folder: Path, device: str, record: dict[str, Any],
        begun: float, require_own: Callable[[], None], start: Reconstructor | None = None,
    ) -> None:  # fmt: skip
        if start is not None:
            require_fit(start, training, validation)
        folder.mkdir(parents=True, exist_ok=True)
        self.record, self.require_own = record, require_own
        self.training, self.validation, self.folder, self.device = training, validation, folder, torch.device(device)
        side, shape = validation.inputs.shape[-1], (validation.targets.shape[-2], validation.targets.shape[-1])
        self.side, self.shape = side, shape
        network = build(training.network, side, shape, training.width, training.seed)
        self.network: nn.Module = network.to(self.device)
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), training.learning_rate, weight_decay=training.weight_decay
        )
        self.epoch = self.step = self.stale = 0
        self.spent = self.summed = self.ended = 0.0
        self.pace = Pace()
        self.best = -math.inf
        self.finished = self.stepping = False
        self.rows: list[dict[str, float]] = []
        if (folder / "checkpoint.pt").exists():
            self.restore()
        elif start is not None:
            self.network.load_state_dict(start.network.state_dict())
            model = self.reconstructor()
            self.best = validated(model, validation)
            model.save(folder / "best.pt")
        self.counted = begun
        write_record(folder, record)

    def count_time(self) -> None:
        """Add what has passed by the clock since the last count."""
        now = time.perf_counter()
        self.spent, self.counted = self.spent + now - self.counted, now

    def spent_but(self, closing: float, seconds: float | None) -> bool:
        """True if so many seconds are spent but for those that a run needs at its end; ``ended`` keeps the answer."""
        if seconds is not None and (self.ended >= seconds or self.spent + closing >= seconds):
            self.ended = max(self.ended, seconds)
            return True
        return False

    @plain_defaults()
    def take_step(self, inputs: Tensor, targets: Tensor, loss_of: Loss, rate: float) -> None:
        """One step of the optimiser at a share of the learning rate."""
        training, self.stepping, begun = self.training, True, time.perf_counter()
        for group in self.optimiser.param_groups:
            group["lr"] = training.learning_rate * rate
        inputs, targets = inputs.to(self.device), targets.to(self.device)
        if training.mirror:
            rng = np.random.default_rng(np.random.SeedSequence([training.seed, self.epoch, self.step]))
            which = torch.from_numpy(rng.random(len(targets)) < 0.5).to(self.device)
            inputs, targets = mirrored(inputs, targets, which)
        self.network.train()
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.device.type == "cuda"):
            logits = self.network(inputs)
        loss = loss_of(logits.float(), targets)
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()
        self.step += 1
        self.summed += loss.item()
        self.pace.stepped += time.perf_counter() - begun
        self.pace.images += len(targets)
        self.stepping = False

    def rehearse_end(self) -> None:
        """Do what the end of an epoch takes, but write nothing: so it can be timed."""
        validated(self.reconstructor(), self.validation)
        for _ in range(2):  # checkpoint and best.pt
            self._state()

    def end_epoch(self) -> dict[str, float]:
        """Validate, log, keep the best, save."""
        model = self.reconstructor()
        score = validated(model, self.validation)
        self.count_time()
        row = {
            "epoch": self.epoch, "seconds": round(self.spent, 3), "train_loss": self.summed / max(self.step, 1),
            f"validation_{TARGETS[self.training.target].scored}": score,
            "learning_rate": self.optimiser.param_groups[0]["lr"], **self.pace.rates(),
        }  # fmt: skip
        self.pace = Pace()
        self.rows.append(row)
        self.stale = 0 if score > self.best else self.stale + 1
        self.require_own()
        if score > self.best:
            self.best = score
            model.save(self.folder / "best.pt")
        self.epoch, self.step, self.summed = self.epoch + 1, 0, 0.0
        self.finished |= self.epoch >= self.training.epochs or self.stale >= self.training.patience
        text = io.StringIO(newline="")
        table = csv.DictWriter(text, list(row))
        table.writeheader()
        table.writerows(self.rows)
        write_whole(self.folder / "log.csv", text.getvalue().encode())
        self.save()  # last: a run that dies before does all this again
        return row

    def reconstructor(self) -> Reconstructor:
        """The network as it is, ready to be used."""
        training = self.training
        return Reconstructor(self.network, training.network, training.input, training.width, self.side, self.shape,
                             self.device, self._trained_on(), training.target)  # fmt: skip

    def _trained_on(self) -> dict[str, Any] | None:
        """Table of the objects that the weights have seen, in this run and before it."""
        mine = self.record["data"].get("recipe", {}).get("objects")
        before = self.record.get("start", {}).get("trained_on")
        if not mine or not before:
            return mine or before
        return mine if mine == before else {"type": "Families", "families": [mine, before]}

    _COUNTERS = ("epoch", "step", "stale", "spent", "summed", "best", "finished", "rows", "ended")

    def save(self) -> None:
        """Write the checkpoint whole, or not at all."""
        content = self._state()
        self.require_own()
        write_whole(self.folder / "checkpoint.pt", content)

    def _state(self) -> bytes:
        """Content of a checkpoint."""
        self.count_time()
        state: dict[str, Any] = {name: getattr(self, name) for name in self._COUNTERS}
        state |= {"record": json.dumps(self.record), "side": self.side, "shape": list(self.shape)}
        state |= {"network": self.network.state_dict(), "optimiser": self.optimiser.state_dict()}
        buffer = io.BytesIO()
        torch.save(state, buffer)
        return buffer.getvalue()

    def restore(self) -> None:
        """Take up the run of the folder."""
        state = torch.load(self.folder / "checkpoint.pt", map_location=self.device, weights_only=True)
        if "record" not in state:
            reject("train.folder", "the folder of a run with a record", str(self.folder),
                   "This run is of an older version. Choose another folder.")  # fmt: skip
        require_same_run(self.folder, json.loads(state["record"]), self.record)
        self.network.load_state_dict(state["network"])
        self.optimiser.load_state_dict(state["optimiser"])
        for name in self._COUNTERS:
            setattr(self, name, state.get(name, 0.0) if name == "ended" else state[name])  # of older runs: none
        self.finished = self.epoch >= self.training.epochs or self.stale >= self.training.patience


def untrained(training: Training, validation: Examples, device: str = "cpu") -> Reconstructor:
    """The network of a run before its first step."""
    side, shape = validation.inputs.shape[-1], (validation.targets.shape[-2], validation.targets.shape[-1])
    network = build(training.network, side, shape, training.width, training.seed).to(device)
    return Reconstructor(
        network, training.network, training.input, training.width, side, shape, device, None, training.target
    )


def require_fit(start: Reconstructor, training: Training, validation: Examples) -> None:
    """Refuse to begin with the weights of another network than the one that is trained."""
    wanted = {
        "target": training.target, "network": training.network, "width": training.width, "input": training.input,
        "side": validation.inputs.shape[-1], "shape": tuple(validation.targets.shape[-2:]),
    }  # fmt: skip
    there = {
        "target": start.target, "network": start.name, "width": start.width, "input": start.input,
        "side": start.side, "shape": tuple(start.shape),
    }  # fmt: skip
    other = [name for name, value in wanted.items() if there[name] != value]
    if other:
        reject("train start", "a model of " + ", ".join(f"{name} {wanted[name]}" for name in other),
               "one of " + ", ".join(f"{name} {there[name]}" for name in other))  # fmt: skip


def validated(model: Reconstructor, examples: Examples) -> float:
    """Score of the model's answers; of objects their mean Pearson correlation after alignment."""
    answers = torch.cat([model(inputs.float()).cpu() for inputs in examples.inputs.split(_CHUNK)])
    return TARGETS[model.target].score(answers, examples.targets)


def read_log(folder: Path) -> list[dict[str, float]]:
    """Rows of a run's log, an epoch each."""
    with (folder / "log.csv").open(newline="") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
