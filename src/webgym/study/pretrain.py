"""Pretraining: from random weights to a policy that sometimes succeeds.

Attempts of the demonstrators at training websites become training sequences of two kinds. *Pointing*: a
picture and several questions about it in one sequence, ``red star = 250 375 , 583 125 = next , jam or home or
7 = home``; without them a model this small does not learn to relate pictures to text. *Acting*: the unchanged
request and reply of a demonstrator's step. Only pointing is trained first, then acting mixed with some
pointing. Muon optimizes the matrices and AdamW the rest: with AdamW alone a model this small learns to point
several times more slowly. All randomness derives from one seed; an interrupted training continues from its
last checkpoint.
"""

from __future__ import annotations

import io
import json
import math
import random
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, TypeAlias

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from pydantic import Field

from webgym.core.settings import Settings
from webgym.core.trajectory import Episode, ImageRef, Message, TextPart
from webgym.inference.model import Loaded, fast_backward_attention
from webgym.inference.rendering import Renderer
from webgym.study.model import CELL, MERGE, PATCH, TinyConfig, cell_centres, save_model

CHECKPOINT = "checkpoint.pt"
LENGTHS = 4
"""Number of groups into which acting sequences are divided by length."""

ADAM_RATE = 2e-3
"""AdamW's learning rate, for everything else."""

MUON_RATE = 0.01
"""Muon's learning rate, for matrices."""

WARMUP_STEPS = 100
"""Updates over which the learning rates rise linearly."""

CHECKPOINT_STEPS = 200
"""Updates between checkpoints."""

REPORT_STEPS = 50
"""Updates between printed lines."""


class PretrainConfig(Settings):
    """Settings of the tiny policy's pretraining."""

    model: TinyConfig = TinyConfig()
    seed: int = 0
    """Seed of the weights and the sequences."""

    steps: int = Field(default=6000, ge=1)
    """Total number of updates."""

    pointing_steps: int = Field(default=1500, ge=0)
    """Number of first updates, which train only pointing."""

    pointing_share: float = Field(default=0.25, ge=0, le=1)
    """Share of the later updates that train pointing."""

    questions: int = Field(default=8, ge=1)
    """Questions per pointing sequence, which has one picture."""

    batch: int = Field(default=48, ge=1)
    """Sequences per update."""

    decay_share: float = Field(default=0.3, ge=0, le=1)
    """Share of the updates, at the end, over which the learning rates fall linearly to 0."""

    weight_decay: float = Field(default=0.01, ge=0)
    """Weight decay of both optimizers."""

    threads: int | None = Field(default=None, ge=1)
    """Threads of torch; by default torch's own choice."""

    device: str = "cpu"
    """Torch device."""

    bfloat16: bool | None = None
    """Compute in bfloat16, with weights in float32: about twice as fast with native support, twenty times
    slower without; by default if the processor supports it."""


# --- training sequences -----------------------------------------------------------------------------------

IGNORED = -100
"""The label of a token that is not learned."""


class TrainingSequence(msgspec.Struct, frozen=True):
    """A training sequence.

    Attributes:
        picture: the screenshot's name.
        ids: tokens, the picture's expanded.
        labels: the tokens with a loss; :data:`IGNORED` elsewhere.
    """

    picture: str
    ids: tuple[int, ...]
    labels: tuple[int, ...]


class Signs(msgspec.Struct, frozen=True):
    """What a screenshot shows: names with the centres of their cells."""

    picture: str
    places: tuple[tuple[str, tuple[int, int]], ...]


def acting(episode: Episode, renderer: Renderer) -> Iterator[TrainingSequence]:
    """A sequence for every step of an attempt that has an action.

    Args:
        episode: of a demonstrator.
        renderer: of the model.
    """
    for step in episode.steps:
        if step.action is None:
            continue
        prompt = renderer.prompt_ids(step.messages)
        reply = renderer.tokenizer(step.reply.text, add_special_tokens=False)["input_ids"]
        target = [*reply, renderer.tokenizer.eos_token_id]
        labels = (IGNORED,) * len(prompt) + tuple(target)
        yield TrainingSequence(step.observation.screenshot, (*prompt, *target), labels)


def signs_of(picture: str, shown: Iterable[tuple[str, tuple[int, int]]], viewport: tuple[int, int]) -> Signs:
    """The signs of a screenshot.

    Args:
        picture: its name.
        shown: names on it, with their upper left corners, pixels.
        viewport: its width and height.
    """
    columns, rows = cell_centres(viewport[0]), cell_centres(viewport[1])
    return Signs(picture, tuple((name, (columns[x // CELL], rows[y // CELL])) for name, (x, y) in shown))


def pointing(
    signs: Signs,
    renderer: Renderer,
    viewport: tuple[int, int],
    rng: random.Random,
    count: int,
    names: Sequence[str],
) -> TrainingSequence:
    """A sequence of questions about a screenshot: positions of names, names at positions, which of several
    names it shows, and numbers next to names.

    Numbers, words and names of two words are equally frequent if the screenshot has them. Positions are asked
    only of names that occur once.

    Args:
        signs: of the screenshot.
        renderer: of the model.
        viewport: width and height of the screenshot, pixels.
        rng: chooses the questions.
        count: number of questions.
        names: all names on any screenshot, from which wrong choices are drawn.
    """
    tokens = renderer.tokenizer
    picture = ImageRef(signs.picture, *viewport)
    ids = renderer.prompt_ids((Message("user", (picture, TextPart("say"))),))
    labels = [IGNORED] * len(ids)
    separator = tokens.convert_tokens_to_ids(",")
    kinds: dict[str, list[tuple[str, tuple[int, int]]]] = {}
    for sign in signs.places:
        kinds.setdefault("number" if sign[0].isdecimal() else f"{sign[0].count(' ')}", []).append(sign)
    times = Counter(name for name, _ in signs.places)
    adjacent_numbers = _adjacent_numbers(signs, viewport)
    for _ in range(count):
        name, (x, y) = rng.choice(kinds[rng.choice(list(kinds))])
        draw = rng.random()
        if adjacent_numbers and draw < 0.25:
            name, answer = rng.choice(adjacent_numbers)
            question = f"number of {name}"
        elif draw < 0.5:
            others = [other for other in rng.sample(names, rng.randint(1, 4)) if other not in times]
            question, answer = " or ".join(rng.sample([name, *others], 1 + len(others))), name
        elif draw < 0.75 and times[name] == 1:
            question, answer = name, f"{x} {y}"
        else:
            question, answer = f"{x} {y}", name
        sides = f"{question} =", answer
        question_ids, answer_ids = (tokens(side, add_special_tokens=False)["input_ids"] for side in sides)
        ids += [*question_ids, *answer_ids, separator]
        labels += [*[IGNORED] * len(question_ids), *answer_ids, IGNORED]
    return TrainingSequence(signs.picture, tuple(ids), tuple(labels))


def _adjacent_numbers(signs: Signs, viewport: tuple[int, int]) -> list[tuple[str, str]]:
    """Names with the number to their right."""
    columns = cell_centres(viewport[0])
    right = dict(pairwise(columns))
    at = {place: name for name, place in signs.places}
    pairs = ((name, at.get((right.get(x, -1), y), "")) for name, (x, y) in signs.places)
    return [(name, other) for name, other in pairs if other.isdecimal() and not name.isdecimal()]


# --- training ---------------------------------------------------------------------------------------------

Kind: TypeAlias = Literal["pointing", "acting"]
Tell: TypeAlias = Callable[[Mapping[str, Any]], None]


class TrainingSet:
    """The training sequences and their pictures.

    Args:
        acting: steps of demonstrators.
        signs: what the screenshots show, for pointing.
        pictures: screenshots by name, PNG.
        renderer: of the model.
        viewport: width and height of all pictures, pixels.
    """

    def __init__(
        self,
        acting: Sequence[TrainingSequence],
        signs: Sequence[Signs],
        pictures: Mapping[str, bytes],
        renderer: Renderer,
        viewport: tuple[int, int],
    ) -> None:
        self.renderer = renderer
        self.acting = sorted(acting, key=lambda sequence: len(sequence.ids))
        self.signs = signs
        self.grid = (1, viewport[1] // PATCH, viewport[0] // PATCH)
        self._viewport = viewport
        self._names = sorted({name for picture_signs in signs for name, _ in picture_signs.places})
        self._pictures = {name: to_patches(png) for name, png in pictures.items()}

    def batch(self, config: PretrainConfig, step: int) -> tuple[Kind, list[TrainingSequence]]:
        """The sequences of an update, all of one kind; determined by the seed and the update's number."""
        rng = random.Random(f"{config.seed}\n{step}")
        if step < config.pointing_steps or rng.random() < config.pointing_share:
            chosen = rng.choices(self.signs, k=config.batch)
            return "pointing", [
                pointing(signs, self.renderer, self._viewport, rng, config.questions, self._names)
                for signs in chosen
            ]
        # Batches of similar lengths have a quarter less padding.
        group, count = rng.randrange(LENGTHS), len(self.acting)
        first, end = group * count // LENGTHS, (group + 1) * count // LENGTHS
        return "acting", rng.choices(self.acting[first : max(end, first + 1)], k=config.batch)

    def tensors(self, sequences: Sequence[TrainingSequence], device: str) -> dict[str, torch.Tensor]:
        """The model's inputs, including labels."""
        longest = max(len(sequence.ids) for sequence in sequences)
        ids = torch.zeros(len(sequences), longest, dtype=torch.int64)
        labels = torch.full_like(ids, IGNORED)
        mask = torch.zeros_like(ids)
        for row, sequence in enumerate(sequences):
            ids[row, : len(sequence.ids)] = torch.tensor(sequence.ids)
            labels[row, : len(sequence.ids)] = torch.tensor(sequence.labels)
            mask[row, : len(sequence.ids)] = 1
        pixels = np.concatenate([to_pixel_values(self._pictures[sequence.picture]) for sequence in sequences])
        inputs = {
            "input_ids": ids,
            "attention_mask": mask,
            "labels": labels,
            "mm_token_type_ids": (ids == self.renderer.image_id).int(),
            "pixel_values": torch.from_numpy(pixels),
            "image_grid_thw": torch.tensor([self.grid] * len(sequences)),
        }
        return {name: tensor.to(device) for name, tensor in inputs.items()}


def _has_bfloat16(device: torch.device) -> bool:
    if device.type == "cpu":
        return bool(torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported())
    return True


def optimizers_of(model: Any, config: PretrainConfig, dtype: torch.dtype) -> list[torch.optim.Optimizer]:
    """Muon for the matrices between layers, AdamW for embeddings, norms, biases and the patch projection."""
    matrices, rest = list[torch.nn.Parameter](), list[torch.nn.Parameter]()
    for name, weight in model.named_parameters():
        is_matrix = weight.ndim == 2 and not any(part in name for part in ("embed", "lm_head"))
        (matrices if is_matrix else rest).append(weight)
    decay = config.weight_decay
    return [
        Muon(matrices, lr=MUON_RATE, weight_decay=decay, dtype=dtype),
        torch.optim.AdamW(rest, lr=ADAM_RATE, betas=(0.9, 0.95), weight_decay=decay),
    ]


def rate(config: PretrainConfig, step: int) -> float:
    """Factor on the learning rates at an update: it rises, is constant, and falls to 0."""
    falling = max(1.0, config.decay_share * config.steps)
    return min(1.0, (step + 1) / max(1, WARMUP_STEPS), max(0.0, (config.steps - step) / falling))


def pretrain(sequences: TrainingSet, loaded: Loaded, out: Path, config: PretrainConfig, tell: Tell) -> None:
    """Train a model on sequences, and save it in ``out``.

    Args:
        sequences: the training data.
        loaded: the model, with random weights; trained in place.
        out: output folder; training continues from a checkpoint in it.
        config: of the pretraining.
        tell: called with figures every ``REPORT_STEPS`` updates.
    """
    out.mkdir(parents=True, exist_ok=True)
    if config.threads is not None:
        torch.set_num_threads(config.threads)
    device = torch.device(config.device)
    uses_bfloat16 = _has_bfloat16(device) if config.bfloat16 is None else config.bfloat16
    model = loaded.model.to(device).train()
    optimizers = optimizers_of(model, config, torch.bfloat16 if uses_bfloat16 else torch.float32)
    first = _restore(out, model, optimizers, config)
    started, smooth = time.monotonic(), dict[Kind, float](pointing=math.nan, acting=math.nan)
    for step in range(first, config.steps):
        for optimizer, peak in zip(optimizers, (MUON_RATE, ADAM_RATE), strict=True):
            for group in optimizer.param_groups:
                group["lr"] = peak * rate(config, step)
        kind, chosen = sequences.batch(config, step)
        tensors = sequences.tensors(chosen, config.device)
        with (
            torch.autocast(device.type, torch.bfloat16, enabled=uses_bfloat16),
            fast_backward_attention(device),
        ):
            loss = model(**tensors, use_cache=False).loss
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        for optimizer in optimizers:
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        value = float(loss.detach())
        smooth[kind] = value if math.isnan(smooth[kind]) else 0.95 * smooth[kind] + 0.05 * value
        if (step + 1) % REPORT_STEPS == 0:
            done = (step + 1 - first) * config.batch
            tell({"step": step + 1, "sequences_per_second": done / (time.monotonic() - started), **smooth})
        if (step + 1) % CHECKPOINT_STEPS == 0 or step + 1 == config.steps:
            _save_checkpoint(out, model, optimizers, config, step + 1)
    model.eval().to(torch.bfloat16)  # half the size; it is read as float32 again
    new = out / "model.new"
    shutil.rmtree(new, ignore_errors=True)
    save_model(loaded, new)
    new.rename(out / "model")  # atomic: the model is always complete


def _save_checkpoint(
    out: Path, model: Any, optimizers: Sequence[torch.optim.Optimizer], config: PretrainConfig, step: int
) -> None:
    checkpoint = {
        "step": step,
        "config": config.model_dump_json(),
        "model": model.state_dict(),
        "optimizers": [optimizer.state_dict() for optimizer in optimizers],
    }
    torch.save(checkpoint, out / f"{CHECKPOINT}.new")
    (out / f"{CHECKPOINT}.new").replace(out / CHECKPOINT)


def _restore(
    out: Path, model: Any, optimizers: Sequence[torch.optim.Optimizer], config: PretrainConfig
) -> int:
    """Load a checkpoint of the same model, if there is one; returns its number of updates."""
    if not (out / CHECKPOINT).exists():
        return 0
    checkpoint = torch.load(out / CHECKPOINT, weights_only=True, map_location=config.device)
    if json.loads(checkpoint["config"])["model"] != json.loads(config.model_dump_json())["model"]:
        return 0
    model.load_state_dict(checkpoint["model"])
    for optimizer, state in zip(optimizers, checkpoint["optimizers"], strict=True):
        optimizer.load_state_dict(state)
    return int(checkpoint["step"])


_COEFFICIENTS = (3.4445, -4.7750, 2.0315)
"""Coefficients of the quintic iteration (Jordan et al. 2024), which converges in five rounds."""


class Muon(torch.optim.Optimizer):
    """Muon for two-dimensional parameters: the momentum of matrices is orthogonalised before each step.

    ``torch.optim.Muon`` does the same, but one matrix at a time and always in bfloat16, which CPUs without
    native support emulate (an optimizer step then takes a hundred times longer than the rest of an update).

    Args:
        params: two-dimensional parameters.
        lr: learning rate, for a square matrix; taller ones take larger steps.
        momentum: coefficient of the Nesterov momentum.
        weight_decay: decoupled weight decay.
        rounds: iterations of the orthogonalisation.
        dtype: of the orthogonalisation.
    """

    def __init__(
        self,
        params: Iterable[torch.nn.Parameter],
        lr: float = 0.01,
        momentum: float = 0.95,
        weight_decay: float = 0.0,
        rounds: int = 5,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        defaults = {"lr": lr, "momentum": momentum, "weight_decay": weight_decay, "rounds": rounds}
        super().__init__(params, defaults)
        self._dtype = dtype

    @torch.no_grad()
    def step(self, closure: Any = None) -> None:
        """Make a step. Matrices of the same shape are orthogonalised together."""
        del closure
        for group in self.param_groups:
            shapes: dict[torch.Size, list[torch.nn.Parameter]] = {}
            for weight in group["params"]:
                if weight.grad is not None:
                    shapes.setdefault(weight.shape, []).append(weight)
            for weights in shapes.values():
                momenta = [self._momentum(weight, group["momentum"]) for weight in weights]
                directions = orthogonal(torch.stack(momenta).to(self._dtype), group["rounds"])
                rate = group["lr"] * max(1.0, weights[0].shape[0] / weights[0].shape[1]) ** 0.5
                for weight, direction in zip(weights, directions, strict=True):
                    weight.mul_(1 - group["lr"] * group["weight_decay"]).sub_(direction, alpha=rate)

    def _momentum(self, weight: torch.nn.Parameter, momentum: float) -> torch.Tensor:
        assert weight.grad is not None
        state = self.state[weight]
        if "momentum" not in state:
            state["momentum"] = torch.zeros_like(weight)
        average: torch.Tensor = state["momentum"]
        average.lerp_(weight.grad, 1 - momentum)
        return weight.grad.lerp(average, momentum)


def orthogonal(matrices: torch.Tensor, rounds: int) -> torch.Tensor:
    """Approximately the nearest orthogonal matrices: singular values are between 0.7 and 1.2.

    Args:
        matrices: (matrices, rows, columns), float32 or bfloat16.
        rounds: number of Newton-Schulz iterations.
    """
    a, b, c = _COEFFICIENTS
    is_tall = matrices.shape[-2] > matrices.shape[-1]
    x = matrices.mT if is_tall else matrices
    x = x / (x.norm(dim=(-2, -1), keepdim=True) + 1e-7)
    for _ in range(rounds):
        square = x @ x.mT
        x = a * x + (b * square + c * square @ square) @ x
    return x.mT if is_tall else x


FRAMES = 2
"""A picture counts as two frames of a video."""


def to_patches(png: bytes) -> NDArray[np.uint8]:
    """A screenshot cut into patches in the order of the vision tower.

    Args:
        png: a picture whose sides are multiples of a cell.

    Returns:
        (patches, 3 x patch side squared), uint8.
    """
    with Image.open(io.BytesIO(png)) as picture:
        pixels = np.asarray(picture.convert("RGB"))
    rows, columns = pixels.shape[0] // PATCH, pixels.shape[1] // PATCH
    blocks = pixels.reshape(rows // MERGE, MERGE, PATCH, columns // MERGE, MERGE, PATCH, 3)
    ordered = blocks.transpose(0, 3, 1, 4, 6, 2, 5)
    return np.ascontiguousarray(ordered.reshape(rows * columns, 3 * PATCH * PATCH))


def to_pixel_values(patches: NDArray[np.uint8]) -> NDArray[np.float32]:
    """What the vision tower reads: colours from -1 to 1, the frame twice.

    Args:
        patches: (patches, 3 x patch side squared), as :func:`to_patches` made them.

    Returns:
        (patches, 3 x frames x patch side squared), float32.
    """
    colours = patches.astype(np.float32).reshape(len(patches), 3, 1, PATCH * PATCH) / 127.5 - 1.0
    return np.repeat(colours, FRAMES, axis=2).reshape(len(patches), -1)
