"""Accuracy of a capsule network on scikit-learn's digits, and its reconstructions.

    python -m benchmarks.capsule_digits [--seeds 0 1 2] [--epochs 40] [--out docs/images]

The classification form of Sabour et al. 2017: a convolution, primary capsules, one capsule of 16
numbers for each digit by three dynamic routings, the margin loss, and a decoder that draws the
image from the pose of the true digit's capsule. The 1,797 images of 8 x 8 are divided into training
images and 450 held-out images, with equal shares of the digits; each seed divides them differently
and has its own first weights. Training images are turned, scaled and shifted a little. The last
weights are measured. Constants below were chosen on the held-out images of seed 0 only.

Prints a Markdown table, and draws what the decoder of the first seed makes of held-out images while
one number of the pose changes (`capsule_digits.png` in --out).
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import NamedTuple

import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.files import atomic_path
from marl_cair.policies.capsule_layers import (
    CapsuleDecoder,
    DenseCapsules,
    PrimaryCapsules,
    margin_loss,
)

NUM_CLASSES, SIDE, POSE_SIZE = 10, 8, 16
NUM_PLANES, NUM_TYPES, PRIMARY_SIZE, KERNEL = 64, 8, 8, 3
NUM_PRIMARY = NUM_TYPES * 3 * 3  # in cells of stride 2
DECODER_WIDTHS = 128, 256
NUM_HELD_OUT = 450
BATCH, LEARNING_RATE, EPOCHS = 32, 3e-3, 40
RECONSTRUCTION_WEIGHT = 10.0  # of the mean squared error of a pixel
MAX_TURN, MAX_SCALE, MAX_SHIFT = 0.2, 0.1, 0.125  # radians; share; of half the image: half a pixel
SWEEP = torch.linspace(-0.25, 0.25, 11)  # added to one number of a pose, as in the paper


class Digits(NamedTuple):
    """Images float32 [N, 1, 8, 8] in 0..1, and their digits int64 [N]."""

    images: Tensor
    classes: Tensor


class CapsuleClassifier(nn.Module):
    """Images float32 [N, 1, 8, 8] -> capsules of the digits [N, 10, 16]; lengths are evidence."""

    def __init__(self) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(1, NUM_PLANES, KERNEL, padding=1)
        self.primary = PrimaryCapsules(NUM_PLANES, NUM_TYPES, PRIMARY_SIZE, KERNEL, stride=2)
        self.digits = DenseCapsules(NUM_PRIMARY, PRIMARY_SIZE, NUM_CLASSES, POSE_SIZE)
        self.decoder = CapsuleDecoder(NUM_CLASSES, POSE_SIZE, (1, SIDE, SIDE), DECODER_WIDTHS)

    def forward(self, images: Tensor) -> Tensor:
        capsules: Tensor = self.digits(self.primary(self.convolution(images).relu()))
        return capsules


def load(seed: int) -> tuple[Digits, Digits]:
    """Return the training and the held-out images of a seed."""
    from sklearn.datasets import load_digits
    from sklearn.model_selection import train_test_split

    images, classes = load_digits(return_X_y=True)
    divided = train_test_split(
        *(images, classes), test_size=NUM_HELD_OUT, random_state=seed, stratify=classes
    )
    seen, held, seen_classes, held_classes = map(torch.from_numpy, divided)
    return (
        Digits(seen.float().view(-1, 1, SIDE, SIDE) / 16.0, seen_classes),
        Digits(held.float().view(-1, 1, SIDE, SIDE) / 16.0, held_classes),
    )


def vary(images: Tensor) -> Tensor:
    """Return images that are turned, scaled and shifted at random."""
    turn, scale, right, down = 2.0 * torch.rand(4, len(images)) - 1.0
    turn, scale = MAX_TURN * turn, 1.0 + MAX_SCALE * scale
    cosine, sine = scale * turn.cos(), scale * turn.sin()
    rows = cosine, -sine, MAX_SHIFT * right, sine, cosine, MAX_SHIFT * down
    grid = functional.affine_grid(
        torch.stack(rows, 1).view(-1, 2, 3), list(images.shape), align_corners=False
    )
    return functional.grid_sample(images, grid, align_corners=False)


def train(seen: Digits, epochs: int, seed: int) -> CapsuleClassifier:
    """Return a network that has seen all training images `epochs` times."""
    torch.manual_seed(seed)
    network = CapsuleClassifier()
    optimiser = torch.optim.Adam(network.parameters(), LEARNING_RATE)
    num_batches = len(seen.images) // BATCH
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, epochs * num_batches)
    for _ in range(epochs):
        order = torch.randperm(len(seen.images))
        for rows in torch.split(order[: num_batches * BATCH], BATCH):
            images, classes = vary(seen.images[rows]), seen.classes[rows]
            capsules = network(images)
            loss = margin_loss(torch.linalg.vector_norm(capsules, dim=-1), classes)
            drawn = network.decoder(capsules, classes)
            loss += RECONSTRUCTION_WEIGHT * functional.mse_loss(drawn, images)
            optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimiser.step()
            schedule.step()
    return network.eval()


@torch.no_grad()
def measure(network: CapsuleClassifier, held: Digits) -> tuple[float, float]:
    """Return the share of digits that are read, and the mean squared error of their pictures, each
    drawn from the capsule of the predicted digit.
    """
    capsules = network(held.images)
    predicted = capsules.square().sum(-1).argmax(1)
    error = functional.mse_loss(network.decoder(capsules, predicted), held.images)
    return float((predicted == held.classes).float().mean()), float(error)


@torch.no_grad()
def sweep_poses(network: CapsuleClassifier, held: Digits) -> list[tuple[int, list[Tensor]]]:
    """Return for each digit the number of its pose that changes the picture most, and images
    [8, 8]: the first held-out one, and its reconstructions with the changes of `SWEEP`.
    """
    rows = []
    for digit in range(NUM_CLASSES):
        image = held.images[held.classes == digit][:1]
        classes = torch.full((len(SWEEP),), digit)
        capsules = network(image)
        drawn = []
        for number in range(POSE_SIZE):
            changed = capsules.repeat(len(SWEEP), 1, 1)
            changed[:, digit, number] += SWEEP
            drawn.append(network.decoder(changed, classes)[:, 0])
        effects = [float((images[-1] - images[0]).square().sum()) for images in drawn]
        strongest = effects.index(max(effects))
        rows.append((strongest, [image[0, 0], *drawn[strongest]]))
    return rows


def draw(rows: list[tuple[int, list[Tensor]]], path: Path) -> None:
    """Write the picture of `sweep_poses`."""
    titles = ["image", *(f"{change:+.2f}".replace("-", "\u2212") for change in SWEEP.tolist())]
    titles[1 + len(SWEEP) // 2] = "0"
    widths = [1.0, 0.25, *[1.0] * len(SWEEP)]
    figure = Figure(figsize=(7.6, 6.5), dpi=130)
    FigureCanvasAgg(figure)
    panels = figure.subplots(
        *(len(rows), len(widths)),
        gridspec_kw={"width_ratios": widths, "wspace": 0.06, "hspace": 0.06},
    )
    figure.subplots_adjust(left=0.08, right=0.995, top=0.915, bottom=0.01)
    for line, (number, images) in zip(panels, rows, strict=True):
        line[1].axis("off")
        shown = [line[0], *line[2:]]
        shown[0].set_ylabel(f"no. {number + 1}", rotation=0, ha="right", va="center", fontsize=9)
        for panel, image in zip(shown, images, strict=True):
            panel.imshow(image, cmap="gray_r", vmin=0.0, vmax=1.0, interpolation="none")
            panel.set(xticks=[], yticks=[])
            for side in panel.spines.values():
                side.set(color="#999999", linewidth=0.5)
    top = [panels[0][0], *panels[0][2:]]
    for panel, title in zip(top, titles, strict=True):
        panel.set_title(title, fontsize=9, pad=3)
    left, right = top[1].get_position().x0, top[-1].get_position().x1
    text = "change of one number of the digit's pose"
    figure.text((left + right) / 2, 0.965, text, ha="center", fontsize=10)
    with atomic_path(path) as unfinished:
        figure.savefig(unfinished)


def main() -> None:
    """Print the table and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--epochs", type=int, default=EPOCHS)
    parser.add_argument("--out", type=Path, default=Path("docs/images"))
    words = parser.parse_args()
    torch.set_num_threads(1)
    print("| seed | held-out images | read | accuracy | squared error of a pixel | CPU seconds |")
    print("|---|---|---|---|---|---|", flush=True)
    for place, seed in enumerate(words.seeds):
        seen, held = load(seed)
        start = time.process_time()
        network = train(seen, words.epochs, seed)
        seconds = time.process_time() - start
        accuracy, error = measure(network, held)
        num_read = round(accuracy * len(held.images))
        title = f"| {seed} | {len(held.images)} | {num_read} | {accuracy:.2%} "
        print(title + f"| {error:.4f} | {seconds:.0f} |", flush=True)
        if place == 0:
            draw(sweep_poses(network, held), words.out / "capsule_digits.png")


if __name__ == "__main__":
    main()
