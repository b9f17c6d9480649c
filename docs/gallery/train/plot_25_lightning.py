"""
Train with Lightning
====================

Lightning takes the loader of a stream as it is. A small network reconstructs characters from the autocorrelation of
camera images. Each image is rendered once and not stored. Needs the extra ``lightning``.
"""

import lightning
import torch
from matplotlib import pyplot as plt
from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.models.metrics import align, pearson
from torch import nn

SIDE, NEAR = 16, 24
recipe = load_recipe("through-slab", {
    "objects": {"shape": [SIDE, SIDE], "rotation": 0.0, "size": [0.8, 0.9]}, "camera": {"shape": [96, 96]},
    "samples": {"train": 2048, "validation": 64},
})  # fmt: skip


def lags(image):
    """Autocorrelation of images float[B, H, W] about their mean, the lags near the middle, 1 at zero lag."""
    image = image.float() / image.float().mean((1, 2), keepdim=True) - 1
    found = torch.fft.fftshift(torch.fft.ifft2(torch.fft.fft2(image).abs().square()).real, dim=(1, 2))
    middle = slice(image.shape[1] // 2 - NEAR, image.shape[1] // 2 + NEAR)
    return (found / found.amax((1, 2), keepdim=True))[:, middle, middle]


class Seeing(lightning.LightningModule):
    """Autocorrelation to object; the loss is 1 - r after alignment by shift and 180-degree rotation."""

    def __init__(self):
        super().__init__()
        torch.manual_seed(0)
        self.layers = nn.Sequential(
            nn.Flatten(), nn.Linear(4 * NEAR**2, 512), nn.GELU(), nn.Linear(512, SIDE**2), nn.Sigmoid()
        )
        self.losses, self.held_out = [], []

    def forward(self, image):
        return self.layers(lags(image)).reshape(-1, SIDE, SIDE)

    def loss(self, batch):
        made = self(batch["image"])
        return 1 - pearson(align(made, batch["object"]), batch["object"]).mean()

    def training_step(self, batch, number):
        loss = self.loss(batch)
        self.losses.append(float(loss.detach()))
        return loss

    def validation_step(self, batch, number):
        self.held_out.append((len(self.losses), float(self.loss(batch))))

    def configure_optimizers(self):
        return torch.optim.AdamW(self.parameters(), 1e-3)


# %%
# Splits share no media and no characters. A checkpoint contains the position in the stream.
new, held_out = (SpeckleStream(recipe, split=split, batch_size=32) for split in ("train", "validation"))
model = Seeing()
trainer = lightning.Trainer(
    max_epochs=2, accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
    enable_model_summary=False,
)  # fmt: skip
trainer.fit(model, new.loader(), held_out.loader())

axes = plt.subplots(layout="constrained")[1]
axes.plot(model.losses, lw=0.7, label="training")
axes.plot(*zip(*model.held_out, strict=True), "o", ms=4, label="validation")
axes.set(xlabel="step", ylabel="1 - r after alignment")
axes.legend()
plt.show()

# %%
# Camera images of the test split, reconstructions, and hidden objects.
batch = next(iter(SpeckleStream(recipe, split="test", batch_size=4).loader()))
with torch.no_grad():
    made = align(model(batch["image"]), batch["object"])
figure, rows = plt.subplots(3, 4, figsize=(4.2, 3.6), layout="constrained")
for row, (name, pictures) in enumerate({"camera": batch["image"], "network": made, "hidden": batch["object"]}.items()):
    rows[row, 0].set_title(name, loc="left", fontsize=9)
    for axis, picture in zip(rows[row], pictures, strict=True):
        axis.imshow(picture, cmap="gray")
        axis.set_axis_off()
plt.show()
