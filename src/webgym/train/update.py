"""The update: samples -> loss -> optimizer step -> weights on disk.

    updater = Updater(config, objective, source="Qwen/Qwen3-VL-8B-Instruct")
    report = updater.update(samples, passes=2)
    updater.save(folder)                        # atomic; the next Updater can resume from it

:meth:`Updater.update` is the whole algorithm. The same samples give the same update for any number of
processes (``accelerate launch``) and any size of micro-batches: the loss of an optimizer step is

    sum of the losses of all reply tokens of the effective batch / number of those tokens

with the number summed over all processes before the first forward pass. For filtered behaviour cloning that
is the log-likelihood of the actions (a sum over tokens, as in the paper), scaled so that the learning rate
does not depend on the length of replies.

:class:`Learner` turns a draw from the replay buffer into saved weights.
"""

from __future__ import annotations

import math
import random
import time
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any, Final

import msgspec
import torch
from accelerate import Accelerator, PartialState
from accelerate.utils import DistributedType, InitProcessGroupKwargs, gather_object, reduce, set_seed

from webgym.core.errors import ConfigError, TrainingError
from webgym.core.trajectory import Step
from webgym.inference.model import Loaded, fast_backward_attention, load_model
from webgym.store.runs import RunReader
from webgym.train import sharding
from webgym.train.config import LearnConfig, UpdateConfig
from webgym.train.estimate import model_flops, peak_flops, shapes_from
from webgym.train.folder import TrainingFolder
from webgym.train.logprobs import Batch, ReplyLogProbs, batches_ahead, collate
from webgym.train.objectives import Need, Objective, Tokens, divergence
from webgym.train.replay import ReplaySample, StepRef
from webgym.train.samples import Sample, SampleMaker
from webgym.train.selftest import (
    NEAR_TIE,
    REPLY_TOKENS,
    Greedy,
    SelfTest,
    known_messages,
    known_picture,
    read_selftest,
)
from webgym.train.sharding import MOMENTS
from webgym.train.weights import UpdateState, load_trainable, load_training, read_state, save

SAVE_LIMIT = timedelta(hours=2)
"""How long processes wait for each other, as for the first, which writes weights and optimizer; NCCL's own
limit is 10 minutes."""
_LOWER_RATE = (
    "nothing of this update was saved: lower learn.update.learning_rate in config.yaml, "
    "then resume with --resume"
)


class UpdateReport(msgspec.Struct, frozen=True):
    """Figures of an update, for the log.

    Attributes:
        samples: number of samples, each trained on once per pass.
        tokens: number of reply tokens trained on.
        prompt_tokens: number of prompt tokens.
        optimizer_steps: in this update.
        loss: mean over the optimizer steps.
        grad_norm: mean norm of the gradient before clipping.
        learning_rate: of the last optimizer step.
        seconds: wall time.
        tokens_per_second: prompt and reply tokens, over all processes.
        extra: means over tokens: ``entropy`` and ``logprob`` of the replies under the weights as they were
            trained, and the objective's own figures. Besides them ``..._max``, of all tokens;
            ``logprob_mismatch``, the mean difference of the log-probabilities that server and learner have
            for the same weights; ``kl_start``, the divergence of the new weights from those that learning
            started from.
    """

    samples: int
    tokens: int
    prompt_tokens: int
    optimizer_steps: int
    loss: float
    grad_norm: float
    learning_rate: float
    seconds: float
    tokens_per_second: float
    extra: dict[str, float] = {}


def learning_rate(config: UpdateConfig, step: int) -> float:
    """The learning rate of optimizer step ``step``, from 0: linear warm-up, then constant or cosine."""
    warm = min(1.0, (step + 1) / (config.warmup_steps + 1))
    if config.schedule == "constant":
        return config.learning_rate * warm
    assert config.total_steps is not None
    past = max(0, step - config.warmup_steps) / max(1, config.total_steps - config.warmup_steps)
    fallen = 0.5 * (1 - math.cos(math.pi * min(1.0, past)))
    return config.learning_rate * warm * (1 - (1 - config.final_rate) * fallen)


class Updater:
    """Weights, optimizer and schedule. Make one per process; all processes call the same methods.

    Args:
        config: of the update.
        objective: the training objective.
        source: folder or hub id of the initial weights, or a loaded model.
        resume: a folder written by :meth:`save` to resume from; ``None`` to start.

    Raises:
        ConfigError: there is no such model, its weights are incomplete, or DeepSpeed is set to offload.
        TrainingError: the folder to resume from does not match the settings.
    """

    def __init__(
        self,
        config: UpdateConfig,
        objective: Objective,
        source: str | Path | Loaded,
        *,
        resume: Path | None = None,
    ) -> None:
        self.config = config
        self.objective = objective
        self.source = source.model.name_or_path if isinstance(source, Loaded) else str(source)
        # Processes and sharding as accelerate launch says.
        self.accelerator = Accelerator(kwargs_handlers=[InitProcessGroupKwargs(timeout=SAVE_LIMIT)])
        self.accelerator.gradient_accumulation_steps = 1  # the update marks the last micro-batch itself
        self._is_zero = self.accelerator.distributed_type == DistributedType.DEEPSPEED
        self._is_fsdp = sharding.is_fsdp(self.accelerator.num_processes)
        if self._is_zero:
            sharding.configure_zero(self.accelerator, config)
        set_seed(config.seed)
        self.loaded = load_trainable(config, source, resume)
        self.renderer = self.loaded.renderer
        model, is_bf16 = self.loaded.model, config.precision == "bf16"
        module = ReplyLogProbs(model, config.logit_tokens, autocast=is_bf16 and not self._is_fsdp)
        if self._is_fsdp:
            sharding.shard(module, model, self.accelerator.device, bf16=is_bf16)
        if resume is not None:  # the files for servers may be rounded
            load_training(resume, {f"weights/{name}": each.detach() for name, each in self._saved()})
        trained = [each for each in model.parameters() if each.requires_grad]
        optimizer = torch.optim.AdamW(
            [
                {"params": [each for each in trained if each.ndim >= 2]},
                {"params": [each for each in trained if each.ndim < 2], "weight_decay": 0.0},
            ],
            lr=config.learning_rate,
            betas=config.betas,
            weight_decay=config.weight_decay,
        )
        self.model: Any = module
        self.optimizer: Any = optimizer
        if not self._is_fsdp:
            self.model, self.optimizer = self.accelerator.prepare(module, optimizer)
        self.step = 0 if resume is None else read_state(resume).step
        self._begin_moments(resume)
        self._greedy_reply: Greedy | None = None  # of the current weights to the self-test's request
        self._since = ""  # version of the weights before the last update
        test = read_selftest(resume) if resume is not None else None
        self._first_reply = test.first if test is not None else None  # of those that learning started from
        self._needs: Collection[Need] = getattr(objective, "needs", ())
        # The start is known where adapters can be switched off, or a whole second model is loaded.
        is_sharded = self._is_fsdp or self._is_zero
        self._knows_start = config.lora is not None or not (is_sharded or isinstance(source, Loaded))
        if "start" in self._needs and not self._knows_start:
            raise ConfigError(
                "the objective needs the log-probabilities of the start, which sharded weights do not keep",
                hint="train adapters (learn.update.lora), or set kl to 0 in learn.objective.options",
            )
        self._start_model: Any = None

    def update(self, samples: Sequence[Sample], *, passes: int = 1, version: str = "") -> UpdateReport:
        """Train on samples, which must be the same, in the same order, in every process.

        Args:
            samples: to train on.
            passes: how often.
            version: of the current weights, as replies record it, for the figures and the self-test.

        Raises:
            TrainingError: the loss or the gradient is not finite. Nothing was saved.
            ValueError: there are no samples.
        """
        if not samples:
            raise ValueError("there is nothing to train on")
        config, started, figures = self.config, time.perf_counter(), _Figures()
        self.optimizer.zero_grad()  # those of an update that failed
        self._greedy_reply, self._since = self._greedy_reply or self._greedy(), version
        every = range(len(samples))
        proximal = self._logprobs(samples, every) if self.objective.off_policy else None
        start = self._start_logprobs(samples, every) if "start" in self._needs else None
        losses, norms, rate = [], [], 0.0
        plan = [
            (batch, list(self._micro_batches(samples, batch))) for batch in self._batches(samples, passes)
        ]
        ahead = self._ahead(samples, (micro for _, micros in plan for micro, _ in micros))
        for batch, micros in plan:
            known: dict[str, dict[int, torch.Tensor] | None] = {"proximal": proximal, "start": start}
            if "drift" in self._needs:
                assert proximal is not None
                known |= _of_trajectories(samples, self._logprobs(samples, batch), proximal)
            self.model.train()
            # Dropout depends on the step alone, also after it was resumed from.
            rank = self.accelerator.process_index
            torch.manual_seed(random.Random(f"{config.seed}/{self.step}/{rank}").getrandbits(63))
            tokens = sum(len(samples[index].reply_ids) for index in batch)
            rate = learning_rate(config, self.step)
            for group in self.optimizer.param_groups:
                group["lr"] = rate
            total = torch.zeros((), device=self.accelerator.device)
            for micro, is_last in micros:
                self.accelerator.sync_gradients = is_last  # DeepSpeed clips and steps in that backward pass
                # FSDP2 splits gradients again in every backward pass: whole ones would not fit.
                at_once = is_last or self._is_fsdp
                with nullcontext() if at_once else self.accelerator.no_sync(self.model):
                    loss = self._loss(next(ahead), micro, known, figures)
                    # Gradients are averaged over processes; multiplying by their number gives the sum.
                    with fast_backward_attention(self.accelerator.device):  # also what is recomputed in it
                        self.accelerator.backward(loss * self.accelerator.num_processes / tokens)
                total += loss.detach() / tokens
            loss_now = float(reduce(total, "sum"))
            norm = self._clip()
            if not (math.isfinite(loss_now) and math.isfinite(norm)):
                raise TrainingError(
                    f"the loss of optimizer step {self.step} is {loss_now}, its gradient {norm}",
                    hint=_LOWER_RATE,
                )
            self.optimizer.step()
            self.optimizer.zero_grad()
            self.step += 1
            losses.append(loss_now)
            norms.append(norm)
        seconds = time.perf_counter() - started
        extra = figures.over(passes * sum(len(sample.reply_ids) for sample in samples))
        if proximal is not None and version:
            extra |= _mismatch(samples, proximal, version)
        if self._knows_start and config.start_steps and "kl_start" not in extra:
            extra["kl_start"] = self._divergence_from_start(samples)
        return self._report(samples, passes, losses, norms, rate, extra, seconds)

    def _loss(
        self,
        batch: Batch,
        micro: Sequence[tuple[int, bool]],
        known: Mapping[str, Mapping[int, torch.Tensor] | None],
        figures: _Figures,
    ) -> torch.Tensor:
        """The summed loss of a micro-batch of (sample index, whether it counts)."""
        new, entropy = self.model(batch, entropy=True).unbind(-1)
        real = torch.tensor([is_real for _, is_real in micro], device=new.device)[batch.rows]
        if not real.any():
            return new.sum() * 0.0
        given: dict[str, Any] = {
            name: None if values is None else torch.cat([values[index] for index, _ in micro]).to(new.device)
            for name, values in known.items()
        }
        given |= {"new": new, "advantage": batch.advantage, "behaviour": batch.behaviour, "step": batch.rows}
        counted = {name: None if each is None else each[real] for name, each in given.items()}
        found = self.objective.loss(Tokens(**counted))
        figures.add({"entropy": entropy[real].sum(), "logprob": new[real].detach().sum()} | found.sums)
        figures.add_maxima(found.maxima)
        return found.tokens.sum()

    def _batches(self, samples: Sequence[Sample], passes: int) -> Iterator[list[int]]:
        """Indices of the samples of each optimizer step, the same in every process."""
        rng, count = random.Random(f"{self.config.seed}/{self.step}"), len(samples)
        # Even batches: a small last batch would change the weights as much as a full one.
        pieces = self.config.minibatches or max(1, round(count / self.config.batch))
        is_whole = self.config.minibatches is not None or "drift" in self._needs
        units: dict[object, list[int]] = {}
        for index, sample in enumerate(samples):
            units.setdefault(sample.trajectory if is_whole else index, []).append(index)
        order, pieces = list(units.values()), min(pieces, len(units))
        for _ in range(passes):
            rng.shuffle(order)
            for i in range(pieces):
                part = order[len(order) * i // pieces : len(order) * (i + 1) // pieces]
                yield [index for unit in part for index in unit]

    def _micro_batches(
        self, samples: Sequence[Sample], batch: Sequence[int]
    ) -> Iterator[tuple[list[tuple[int, bool]], bool]]:
        """This process's micro-batches of (sample index, whether it counts), and whether each is the last.

        Every process gets the same number of micro-batches, with samples of similar lengths. A process with
        fewer samples gets one that does not count, because all processes must call the model together.
        """
        count, rank = self.accelerator.num_processes, self.accelerator.process_index
        order = sorted(batch, key=lambda index: (len(samples[index]), index), reverse=True)
        own = [(index, True) for index in order[rank::count]]
        most = -(-len(order) // count)
        own += [(order[-1], False)] * (most - len(own))
        size = self.config.micro_batch
        for start in range(0, most, size):
            yield own[start : start + size], start + size >= most

    @torch.no_grad()
    def _logprobs(
        self, samples: Sequence[Sample], indices: Sequence[int], model: Any = None
    ) -> dict[int, torch.Tensor]:
        """Log-probabilities of these samples' replies, by index, under the current weights or a model's."""
        model = model or self.model
        model.eval()
        found: list[tuple[int, torch.Tensor]] = []
        plan = [micro for micro, _ in self._micro_batches(samples, indices)]
        for micro, batch in zip(plan, self._ahead(samples, plan), strict=True):
            pieces = torch.split(model(batch).cpu(), batch.lengths)
            found += [(index, piece) for (index, _), piece in zip(micro, pieces, strict=True)]
        return dict(gather_object(found))

    def _start_logprobs(self, samples: Sequence[Sample], indices: Sequence[int]) -> dict[int, torch.Tensor]:
        """The same under the weights that learning started from. Without adapters that is a second model, in
        the host's memory while it is not used."""
        if self.config.lora is not None:
            with self.loaded.model.disable_adapter():
                return self._logprobs(samples, indices)
        if self._start_model is None:
            start = load_model(self.source, dtype=self.config.weights).model
            is_bf16 = self.config.precision == "bf16"
            self._start_model = ReplyLogProbs(start, self.config.logit_tokens, autocast=is_bf16)
        try:
            return self._logprobs(samples, indices, self._start_model.to(self.accelerator.device))
        finally:
            self._start_model.to("cpu")

    def _divergence_from_start(self, samples: Sequence[Sample]) -> float:
        """The KL divergence of the current weights from the start, on some samples spread over all."""
        most = min(self.config.start_steps, len(samples))
        some = sorted({len(samples) * number // most for number in range(most)})
        now, then = self._logprobs(samples, some), self._start_logprobs(samples, some)
        return float(divergence(torch.cat([then[index] - now[index] for index in some])).mean())

    def _ahead(
        self, samples: Sequence[Sample], plan: Iterable[Sequence[tuple[int, bool]]]
    ) -> Iterator[Batch]:
        """The batches of micro-batches of (sample index, whether it counts), on this process's device."""
        groups = ([samples[index] for index, _ in micro] for micro in plan)
        made = batches_ahead(groups, self.renderer, off_policy=self.objective.off_policy)
        return (batch.to(self.accelerator.device) for batch in made)

    def save(self, folder: Path) -> None:
        """Write weights, optimizer and schedule atomically; see :mod:`webgym.train.weights`.

        Raises:
            TrainingError: a weight is not finite. Nothing was saved.
            StoreError: they cannot be written; an earlier folder is intact.
        """
        lora, is_first = self.config.lora is not None, self.accelerator.is_main_process
        served = torch.bfloat16 if self.config.precision == "bf16" and not lora else None
        weights = sharding.whole_weights(self._saved(), served, keep=is_first)
        training = self._training()
        after = self._greedy()
        before, self._greedy_reply = self._greedy_reply or after, after
        self._first_reply = self._first_reply or before
        numbers = [*weights.values(), torch.tensor(after.logprobs)]
        if is_first and not all(bool(each.isfinite().all()) for each in numbers):
            raise TrainingError(
                f"the weights after optimizer step {self.step} are not finite", hint=_LOWER_RATE
            )
        save(
            folder,
            self.loaded,
            weights,
            training,
            UpdateState(self.step, self.source, lora),
            self._selftest(before, after),
            processes=PartialState(),
            sharded=self._is_fsdp,
        )

    @torch.no_grad()
    def _greedy(self) -> Greedy:
        """The current weights' reply to the self-test's request. All processes compute the same."""
        self.model.eval()
        messages, picture, renderer = known_messages(), known_picture(), self.renderer
        prompt = torch.tensor(renderer.prompt_ids(messages), dtype=torch.int32)
        tokens: list[tuple[int, float, float]] = []
        while len(tokens) < REPLY_TOKENS and not (tokens and tokens[-1][0] in renderer.end_ids):
            # The last id is a placeholder, whose position is predicted.
            reply = torch.tensor([*(token for token, _, _ in tokens), renderer.pad_id], dtype=torch.int32)
            sample = Sample(prompt, reply, None, 1.0, "", messages, lambda _name: picture)
            batch = collate([sample], renderer, off_policy=False).to(self.accelerator.device)
            (best, second), (token, _) = self.model(batch, ranked=True)[-1].tolist()
            tokens.append((int(token), best, best - second))
        ids, logprobs, margins = zip(*tokens, strict=True)
        return Greedy(list(ids), list(logprobs), list(margins))

    def _selftest(self, before: Greedy, after: Greedy) -> SelfTest:
        certain_length = next(
            (index for index, margin in enumerate(after.margins) if margin <= NEAR_TIE), len(after.ids)
        )
        return SelfTest(
            prompt_ids=self.renderer.prompt_ids(known_messages()),
            image_id=self.renderer.image_id,
            after=after,
            before=before,
            certain=self.renderer.decode(after.ids[:certain_length]),
            is_exact=self.config.precision == "fp32" and self.config.weights == "float32",
            picture=known_picture(),
            first=self._first_reply,
            since=self._since,
        )

    def _clip(self) -> float:
        """Clip the gradients, and return their norm before."""
        limit = self.config.max_grad_norm
        if self._is_fsdp:
            norm: Any = torch.nn.utils.clip_grad_norm_(self.model.parameters(), limit)
            return float(norm.full_tensor())
        return float(self.accelerator.clip_grad_norm_(self.model.parameters(), limit))

    def _saved(self) -> Iterator[tuple[str, Any]]:
        """The parameters that are saved, with their names: all, or those of adapters."""
        every = self.loaded.model.named_parameters()
        return (each for each in every if each[1].requires_grad or self.config.lora is None)

    def _training(self) -> dict[str, torch.Tensor]:
        """What training goes on from, by name: this process's parts, or for the first process all of it."""
        if self._is_zero:
            return sharding.zero_tensors(list(self._saved()), keep=self.accelerator.is_main_process)
        return {f"weights/{name}": each.detach() for name, each in self._saved()} | self._moments()

    def _moments(self) -> dict[str, torch.Tensor]:
        return {
            f"{moment}/{name}": self.optimizer.state[parameter][moment]
            for name, parameter in self._saved()
            for moment in MOMENTS * parameter.requires_grad
        }

    def _begin_moments(self, resume: Path | None) -> None:
        """Set the optimizer's moments: to 0, or to what was saved."""
        load = None if resume is None else partial(load_training, resume)
        if self._is_zero:
            sharding.begin_zero(self.model, list(self._saved()), self.step, load)
            return
        for group in self.optimizer.param_groups:
            for parameter in group["params"]:
                moments = {moment: torch.zeros_like(parameter) for moment in MOMENTS}
                self.optimizer.state[parameter] = {"step": torch.tensor(float(self.step))} | moments
        if load is not None:
            load(self._moments())

    def _report(
        self,
        samples: Sequence[Sample],
        passes: int,
        losses: list[float],
        norms: list[float],
        rate: float,
        extra: dict[str, float],
        seconds: float,
    ) -> UpdateReport:
        tokens = passes * sum(len(sample.reply_ids) for sample in samples)
        prompt_tokens = passes * sum(len(sample.prompt_ids) for sample in samples)
        return UpdateReport(
            samples=len(samples),
            tokens=tokens,
            prompt_tokens=prompt_tokens,
            optimizer_steps=len(losses),
            loss=sum(losses) / len(losses),
            grad_norm=sum(norms) / len(norms),
            learning_rate=rate,
            seconds=seconds,
            tokens_per_second=(tokens + prompt_tokens) / seconds,
            extra=extra,
        )


class _Figures:
    """Sums and maxima over the tokens of an update, in this process."""

    def __init__(self) -> None:
        self._sums, self._maxima = Counter[str](), dict[str, float]()

    def add(self, sums: Mapping[str, torch.Tensor]) -> None:
        self._sums.update({name: float(value.detach()) for name, value in sums.items()})

    def add_maxima(self, maxima: Mapping[str, torch.Tensor]) -> None:
        self._maxima |= {
            name: max(float(value), self._maxima.get(name, -math.inf)) for name, value in maxima.items()
        }

    def over(self, tokens: int) -> dict[str, float]:
        """Means over this many tokens, and maxima, of all processes."""
        processes: list[tuple[Counter[str], dict[str, float]]] = gather_object([(self._sums, self._maxima)])
        means: Counter[str] = Counter()
        maxima: dict[str, float] = {}
        for sums, most in processes:
            means.update(sums)
            maxima |= {name: max(value, maxima.get(name, value)) for name, value in most.items()}
        return {name: means[name] / tokens for name in sorted(means)} | maxima


def _of_trajectories(
    samples: Sequence[Sample], now: Mapping[int, torch.Tensor], proximal: Mapping[int, torch.Tensor]
) -> dict[str, dict[int, torch.Tensor] | None]:
    """:attr:`Tokens.drift` and :attr:`Tokens.lag` of each sample."""
    parts: dict[str, list[torch.Tensor]] = {}
    for index, values in now.items():
        behaviour = samples[index].logprobs
        assert behaviour is not None
        both = torch.stack([values - proximal[index], proximal[index] - behaviour])
        parts.setdefault(samples[index].trajectory, []).append(both)
    means = {trajectory: torch.cat(each, dim=1).mean(dim=1) for trajectory, each in parts.items()}
    return {
        name: {index: means[samples[index].trajectory][row].expand(len(now[index])) for index in now}
        for row, name in enumerate(("drift", "lag"))
    }


def _mismatch(
    samples: Sequence[Sample], proximal: Mapping[int, torch.Tensor], version: str
) -> dict[str, float]:
    """How far the log-probabilities of server and learner are apart, on replies of the same weights."""
    apart = [
        (proximal[index] - sample.logprobs).abs()
        for index, sample in enumerate(samples)
        if sample.version == version and sample.logprobs is not None
    ]
    return {"logprob_mismatch": float(torch.cat(apart).mean())} if apart else {}


_AGAIN: Final = "; then move {iteration} elsewhere, and --resume collects it again"
_TOKENS: Final = f"the stored tokens are not this model's: docs/training.md has the token contract{_AGAIN}"
_HINTS: Final = {
    "altered_sampling": "the objective needs replies of the full distribution: configs/train/group-is.yaml "
    f"has sampling without top-p and top-k{_AGAIN}",
    "no_logprobs": f"the objective needs log-probabilities, and the endpoint gives none{_AGAIN}",
    "too_long": "raise learn.update.cutoff_tokens in config.yaml, then resume with --resume",
    "gone": "their attempts were set aside after the draw: delete {iteration}/replay.json, and --resume "
    "draws others",
}
"""What to do about the most frequent reason; otherwise :data:`_TOKENS`."""


class Learner:
    """Trains in this process; weights and optimizer stay in memory between iterations.

    Args:
        config: replay, objective, update.
        objective: the training objective.
    """

    def __init__(self, config: LearnConfig, objective: Objective) -> None:
        self._config = config
        self._objective = objective
        self._updater: Updater | None = None
        self._latest_saved = 0

    def learn(self, number: int, draw: ReplaySample, folder: TrainingFolder) -> Mapping[str, Any]:
        """Train on drawn steps, and save the iteration's weights.

        Raises:
            TrainingError: every step was dropped, or the loss is not finite.
        """
        try:
            return self._learn(number, draw, folder)
        except BaseException:
            self._updater = None  # its weights may be past those that were saved
            raise

    def _learn(self, number: int, draw: ReplaySample, folder: TrainingFolder) -> Mapping[str, Any]:
        updater = self.updater(folder)
        objective, config = self._objective, self._config.update
        maker = SampleMaker(
            updater.renderer, cutoff_tokens=config.cutoff_tokens, off_policy=objective.off_policy
        )
        samples = samples_of(draw, folder, maker)
        dropped: Counter[str] = Counter(maker.dropped)
        # Of attempts that were set aside after the draw, as those of a corrupt file are.
        if gone := len(draw.steps) - len(samples) - dropped.total():
            dropped["gone"] = gone
        if not samples:
            raise TrainingError(
                f"all {len(draw.steps)} steps were dropped: {dict(dropped)}",
                hint=_HINTS.get(dropped.most_common(1)[0][0], _TOKENS).format(
                    iteration=folder.iteration(number).relative_to(folder.path)
                ),
            )
        latest = folder.latest_weights()
        version = str(latest[0]) if latest else "0"
        report = updater.update(samples, passes=self._config.replay.passes, version=version)
        updater.save(folder.weights(number))
        self._latest_saved = number
        figures = {"dropped": dict(dropped), "stored_tokens": maker.stored, "rebuilt_tokens": maker.rebuilt}
        share = self._peak_share(updater, samples, report)
        return {**msgspec.to_builtins(report), **figures, **({} if share is None else {"peak_share": share})}

    def _peak_share(self, updater: Updater, samples: Sequence[Sample], report: UpdateReport) -> float | None:
        """The model's operations per second over the GPUs' peak; ``None`` where that is not known."""
        if (peak := peak_flops()) is None:
            return None
        with suppress(ConfigError, AttributeError):  # of a model whose shapes are not known
            shapes = shapes_from(updater.loaded.model.config)
            images = sum(int((sample.prompt_ids == updater.renderer.image_id).sum()) for sample in samples)
            patches = images * shapes.merge * self._config.replay.passes
            tokens = report.tokens + report.prompt_tokens
            done = model_flops(shapes, self._config.update, tokens, report.tokens, patches)
            return done / report.seconds / peak
        return None

    def updater(self, folder: TrainingFolder) -> Updater:
        """The updater, with the newest weights of the training's folder."""
        latest = folder.latest_weights()
        if self._updater is None or (latest and latest[0] != self._latest_saved):
            self._updater = Updater(
                self._config.update, self._objective, self._config.model, resume=latest[1] if latest else None
            )
        return self._updater


def samples_of(draw: ReplaySample, folder: TrainingFolder, maker: SampleMaker) -> list[Sample]:
    """The samples of all drawn steps that can be trained on."""
    by_run: dict[int, dict[str, list[StepRef]]] = {}
    for ref in draw.steps:
        by_run.setdefault(ref.iteration, {}).setdefault(ref.attempt_id, []).append(ref)
    samples: list[Sample] = []
    for iteration, attempts in sorted(by_run.items()):
        reader = RunReader(folder.run(iteration))
        steps: list[tuple[StepRef, Step]] = []
        for trajectory in reader.trajectories():
            refs = attempts.get(trajectory.episode.attempt_id, ())
            steps += [(ref, trajectory.episode.steps[ref.index]) for ref in refs]
        # Independent of the order in which attempts ended: the same draw gives the same update.
        steps.sort(key=lambda pair: pair[0])
        for ref, step in steps:
            made = maker.make([(step, ref.advantage)], reader.image)
            samples += [replace(each, trajectory=f"{iteration}/{ref.attempt_id}") for each in made]
    return samples
