"""Settings of a training, which decide a network, given its data.

The options of ``specklegen train`` are made from this class: its docstring is their help. So nothing here imports torch
before a value is made.
"""

from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.values import NonNegative, Positive, PositiveInt, Value


def _name_of(network: str) -> str:
    from specklegen.models.learning.networks import NETWORKS

    return NETWORKS.name_of(NETWORKS.find("Training.network", network))


class Training(Value):
    """Settings that decide a network, given its data.

    Parameters
    ----------
    target
        What the network estimates: object, label (a class), range (of the memory effect), material (range, thickness,
        optical depth, g), motion (tau0, share of the light at rest) or contrast (a map).
    input
        What the network sees: camera, autocorrelation or periodogram, the autocorrelation at the window's frequencies;
        of stacks of tilts registered, how their speckle decorrelates, or registered+power, with the transmitted power;
        of exposures exposures, their contrasts, or, of a surface, local-contrast, maps of them.
    network
        Kind of network: residual (for autocorrelations), lags (for numbers of a medium), unet, stack-unet (for several
        images a sample), dense, perceptron (for tilts or exposures) or contrast (for maps); or your own, by its name or
        as my_module:Name, whose module is run.
    width
        Channels at the top of a U-Net; of dense nets, units over 16.
    loss
        Loss for objects: pearson, bce, ssim, l1, pearson+bce or blurred (of points), with -invariant or without. Other
        targets have losses of their own.
    learning_rate
        Largest learning rate of AdamW: it rises over 50 steps, then falls to 0 along a cosine.
    weight_decay
        Weight decay of AdamW.
    batch_size
        Samples a step.
    epochs
        Passes through the data, or through an epoch's length of a stream.
    patience
        Epochs without a better validation after which training stops.
    mirror
        Show half of the samples mirrored; only for square images whose left and right are alike.
    seed
        Seed of first weights, order and mirroring.

    Examples
    --------
    >>> from specklegen.models import Training
    >>> Training(network="unet", width=8, epochs=2).loss
    'pearson-invariant'
    """

    target: str = "object"
    input: str = "autocorrelation"
    network: Annotated[str, AfterValidator(_name_of)] = "unet"
    width: Annotated[int, Field(ge=1, le=4096)] = 16
    loss: str = "pearson-invariant"
    learning_rate: Positive = 3e-3
    weight_decay: NonNegative = 0.01
    batch_size: PositiveInt = 64
    epochs: PositiveInt = 20
    patience: PositiveInt = 10
    mirror: bool = False
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _check(self) -> Self:
        from specklegen.models.learning.losses import loss_named
        from specklegen.models.learning.networks import NETWORKS

        for field, value in (("input", self.input), ("target", self.target)):
            able = [name for name in NETWORKS if value in getattr(NETWORKS[name], f"{field}s")]
            if self.network not in able:
                names = ", ".join(getattr(NETWORKS[self.network], f"{field}s"))
                reject(f"Training.{field}", f"one of {names} for the network {self.network!r}", value,
                       f"Networks for this {field}: {', '.join(able) or 'none'}.")  # fmt: skip
        if self.target != "object" and self.mirror:
            reject("Training.mirror", "false, since the target is no image of an object", self.mirror)
        if self.target == "object":
            loss_named(self.loss)  # refused before anything is rendered
        return self

    @property
    def of_objects(self) -> bool:
        """True if the target needs hidden objects."""
        from specklegen.models.learning.targets import TARGETS

        return TARGETS[self.target].hidden
