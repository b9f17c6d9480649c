"""Training on one page: batches -> network -> loss -> step, with a line of a log after each epoch.

Everything random is a function of (seed, epoch, step): first weights, order of the samples, mirroring. So a run is
repeated by its settings, and one that was stopped goes on to the same bits. The one exception is a budget in seconds:
there the learning rate falls with the time spent, so that a run ends well whenever it ends. Seconds are those of a
clock on the wall, and count everything: reading or rendering, learning, validating, saving.

Files in the folder of a run: ``run.json`` (settings and data; nothing else goes on with the run), ``checkpoint.pt``
(all that is needed to go on: after each epoch, every few minutes, on Ctrl-C and SIGTERM, and where the data fail),
``best.pt`` (the model with the best score on validation media, of objects the Pearson correlation); ``log.csv``;
``owner`` (which process began last).
"""

import math
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from specklegen.core.devices import checked_device
from specklegen.core.errors import reject
from specklegen.core.interrupts import Interrupt, Terminated, deferred, undisturbed
from specklegen.models.learning.examples import Examples
from specklegen.models.learning.losses import loss_named
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.learning.run import Run
from specklegen.models.learning.run_record import alone, record
from specklegen.models.learning.settings import Training
from specklegen.models.learning.targets import TARGETS

WARM_UP = 50
"""Steps over which the learning rate rises from 0."""


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
    training: Training, data: Examples | tuple[Batches, int], validation: Examples, folder: str | os.PathLike, *,
    seconds: float | None = None, device: str = "cpu", progress: Callable[[dict[str, float]], None] | None = None,
    steps: Callable[[int, int], None] | None = None, about: Mapping[str, Any] | None = None, save_every: float = 300.0,
    stop_after: int | None = None, begun: float | None = None, reserve: float = 0.0, start: Reconstructor | None = None,
) -> Reconstructor:  # fmt: skip
    """Train a network, or go on where the run in this folder was stopped.

    A finished run goes on if more epochs, or more seconds, are asked for; the learning rate is then that of the
    longer run.

    Parameters
    ----------
    training
        Settings: network, width, input, target, loss, epochs, batch size, learning rate, seed (:class:`Training`).
    data
        Examples in memory, or (a function of (epoch, first step) to batches, batches in an epoch) for a stream.
    validation
        Examples of other media and objects.
    folder
        Of the run.
    seconds
        Wall-clock budget, everything included, of all calls for this run together. The end of a run (validation, files)
        is timed before the first step and after each epoch, scaled by the present load of the machine, and reserved.
        One step is made in any case. None: all epochs.
    device
        Torch device. On CUDA the forward pass runs in bfloat16, which the CPU would only emulate.
    progress
        Called with each row of the log; by default nothing is.
    steps
        Called after every step with (steps done, steps in all): of all epochs, or as many as the seconds will do for at
        the pace so far. By default nothing is.
    about
        What "data" and "validation" are, as tables of JSON: recorded with the run, and named where another run differs.
    save_every
        Seconds between checkpoints inside an epoch.
    stop_after
        Steps after which to stop, as if interrupted; the checkpoint is exact.
    begun
        Reading of ``time.perf_counter`` from which this call's seconds count, for callers who have prepared something
        before. By default now.
    reserve
        Seconds of these that the caller needs afterwards.
    start
        Model whose weights the run begins with, instead of those that the seed draws: of the same network, width,
        input and target, for images of the same sizes. It is validated first, and stays the best until a better one is
        found.

    Returns
    -------
    Reconstructor
        The best on validation.

    Raises
    ------
    RuleError
        If the folder holds a run with other settings or data (more epochs are no difference), if the validation
        examples are the training examples, or there are none; if there is no such device; if another process trains
        in the folder; or if the model to start from is another network, or of other sizes.
    KeyboardInterrupt
        On Ctrl-C, after the step that was being made and a checkpoint.
    SystemExit
        On SIGTERM, likewise, with status 143; unless the program has a handler of SIGTERM of its own.

    Examples
    --------
    >>> import tempfile
    >>> import torch
    >>> from specklegen.models import Training, train
    >>> from specklegen.models.learning.examples import Examples
    >>> def noise(seed):
    ...     drawn = torch.Generator().manual_seed(seed)
    ...     inputs, targets = torch.rand(8, 2, 64, 64, generator=drawn), torch.rand(8, 28, 28, generator=drawn)
    ...     return Examples(inputs, targets, media=torch.arange(8))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     network = train(Training(width=4, epochs=1, batch_size=4), noise(0), noise(1), folder)
    >>> network.shape
    (28, 28)
    """
    checked_device("train device", device)
    begun = time.perf_counter() if begun is None else begun
    here = record(training, data if isinstance(data, Examples) else data[0], validation, about, start)
    if isinstance(data, Examples):
        data = shuffled(data, training), math.ceil(len(data.targets) / training.batch_size)
    batches, length = data
    if not length or not len(validation.targets):
        reject("train examples", "at least one for training, and one for validation", (length, len(validation.targets)))
    with alone(Path(folder)) as require_own, deferred() as interrupt:
        run = Run(training, validation, Path(folder), device, here, begun, require_own, start)
        return _trained(run, batches, length, interrupt, seconds, save_every, stop_after, progress, steps, reserve)


def _trained(
    run: Run, batches: Batches, length: int, interrupt: Interrupt, seconds: float | None, save_every: float,
    stop_after: int | None, progress: Callable[[dict[str, float]], None] | None,
    steps: Callable[[int, int], None] | None, reserve: float,
) -> Reconstructor:  # fmt: skip
    run.finished |= run.spent_but(0.0, seconds)
    closing = Closing(reserve)
    if not (seconds is None or run.finished):
        with closing.measured():
            run.rehearse_end()
    loss_of = TARGETS[run.training.target].loss or loss_named(run.training.loss)
    taken, total, saved = 0, length * run.training.epochs, time.monotonic()
    while not run.finished:
        try:
            run.count_time()
            before = run.spent
            for inputs, targets in run.pace.timed(batches(run.epoch, run.step)):
                done = run.epoch * length + run.step
                learning = math.inf if seconds is None else max(seconds - closing.seconds, 1e-9)
                share = max(done / total, run.spent / learning)
                with undisturbed(), closing.stepping():
                    run.take_step(inputs, targets, loss_of, min(1.0, (done + 1) / WARM_UP) * cosine(share))
                taken += 1
                run.count_time()
                if steps is not None:
                    pace = run.spent / learning / (done + 1)
                    steps(done + 1, min(total, max(done + 1, round(1 / pace))) if pace else total)
                if taken == stop_after:
                    run.save()
                    return run.reconstructor()
                interrupt.obey()
                if time.monotonic() - saved > save_every:
                    run.save()
                    saved = time.monotonic()
                if run.spent_but(closing.seconds + run.spent - before, seconds):  # another step would be too late
                    run.finished = True
                    break
                before = run.spent
            interrupt.obey()
        except (Exception, KeyboardInterrupt, Terminated):
            if not run.stepping:
                run.save()
                interrupt.obey()
            raise
        with closing.measured():
            row = run.end_epoch()
            saved = time.monotonic()
            if progress is not None:
                progress(row)
        interrupt.obey()
        run.finished |= run.spent_but(closing.seconds, seconds)
    return Reconstructor.load(run.folder / "best.pt")


@dataclass
class Closing:
    """Seconds by the clock that the end of a run will take.

    Attributes
    ----------
    reserve
        Seconds that the caller needs afterwards.
    ending
        Seconds of the last validation and its files, as measured before the first step and at the end of each epoch.
    load, first
        Seconds by the clock for one of CPU time while ``ending`` was measured, and while it was measured first, which
        stands for the time when the caller measured ``reserve``.
    clock, cpu
        Seconds by the clock and of CPU time of the last steps. On a machine that has become busier their ratio is above
        ``load``, and the end will take as many times longer.
    """

    reserve: float
    ending: float = 0.0
    load: float = 0.0
    first: float = 0.0
    clock: float = 0.0
    cpu: float = 0.0

    @contextmanager
    def measured(self) -> Iterator[None]:
        """Time the end of an epoch, or its rehearsal."""
        clock, cpu = time.perf_counter(), time.process_time()
        yield
        self.ending = time.perf_counter() - clock
        self.load = self.ending / max(time.process_time() - cpu, 1e-9)
        self.first = self.first or self.load

    @contextmanager
    def stepping(self) -> Iterator[None]:
        """Time a step; the last ten count most."""
        clock, cpu = time.perf_counter(), time.process_time()
        yield
        self.clock = 0.9 * self.clock + time.perf_counter() - clock
        self.cpu = 0.9 * self.cpu + time.process_time() - cpu

    @property
    def seconds(self) -> float:
        """Seconds by the clock, at the present load of the machine."""
        load = self.clock / max(self.cpu, 1e-9)
        parts = (self.reserve, self.first), (self.ending, self.load)
        return sum(part * (max(1.0, load / then) if then > 0 else 1.0) for part, then in parts)


def cosine(share: float) -> float:
    """Fall from 1 to 0 along half a cosine."""
    return 0.5 + 0.5 * math.cos(math.pi * min(share, 1.0))
