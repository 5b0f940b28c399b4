"""The update: the loss lies on replies alone, and the same samples give the same weights."""

from __future__ import annotations

import socket
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import safetensors.torch
import torch
from accelerate.utils.deepspeed import HfDeepSpeedConfig
from safetensors.torch import load_file
from tests.conftest import wait_until
from tests.inference.tiny import tiny_renderer, write_tiny_model
from tests.train.forking import process
from tests.train.making import PICTURES, Made, sample, stored, trajectory
from tests.train.updating import learn_first, learning, run_case, run_cases_together, samples, updater

from webgym.core.errors import ConfigError, StoreError, TrainingError
from webgym.core.outcome import Outcome
from webgym.core.trajectory import Reply
from webgym.inference.model import load_model
from webgym.train import sharding
from webgym.train.config import ReplayConfig, UpdateConfig
from webgym.train.folder import TrainingFolder
from webgym.train.logprobs import AHEAD, ReplyLogProbs, batches_ahead, collate
from webgym.train.loop import TrainConfig
from webgym.train.objectives import FilteredBC, GroupIS
from webgym.train.replay import Replay
from webgym.train.samples import Sample, SampleMaker
from webgym.train.update import SAVE_LIMIT, Learner, learning_rate
from webgym.train.weights import read_state

BC = FilteredBC()


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_model(tmp_path_factory.mktemp("model"))


@pytest.fixture(autouse=True)
def short_self_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of whole length are compared with a served model's replies in test_serving.py."""
    monkeypatch.setattr("webgym.train.update.REPLY_TOKENS", 2)


def weights(folder: Path) -> dict[str, torch.Tensor]:
    name = "adapter_model" if (folder / "adapter_config.json").exists() else "model"
    found: dict[str, torch.Tensor] = load_file(folder / f"{name}.safetensors")
    return found


def assert_same(start: Path, one: Path, other: Path, tolerance: float = 1e-3) -> None:
    """Two updates went the same way, but for rounding: they differ by a fraction of how far they went."""
    first, second = weights(one), weights(other)
    assert first.keys() == second.keys()
    origin = weights(start) if (one / "model.safetensors").exists() else dict.fromkeys(first, torch.zeros(()))
    went = sum(float((first[name] - origin[name]).square().sum()) for name in first)
    differ = sum(float((first[name] - second[name]).square().sum()) for name in first)
    assert went > 1e-3
    assert differ <= tolerance**2 * went, (differ / went) ** 0.5


def likelihood(folder: Path) -> float:
    loaded = load_model(folder)
    batch = collate(samples(BC), loaded.renderer, off_policy=False)
    with torch.no_grad():
        return float(ReplyLogProbs(loaded.model, 100)(batch).mean())


def full(*_: object, **__: object) -> None:
    raise OSError(28, "No space left on device")


def test_log_probabilities_are_of_the_reply_tokens_whatever_the_padding_and_the_chunks(model: Path) -> None:
    loaded = load_model(model)
    made = samples(BC)
    batch = collate(made, loaded.renderer, off_policy=False)
    with torch.no_grad():
        found = torch.split(ReplyLogProbs(loaded.model, 3)(batch), batch.lengths)
        for each, got in zip(made, found, strict=True):
            ids = torch.cat([each.prompt_ids, each.reply_ids]).long()[None]
            pixels = each.pixels(loaded.renderer)
            assert pixels is not None
            logits = loaded.model(
                input_ids=ids,
                pixel_values=pixels.values,
                image_grid_thw=pixels.grid,
                mm_token_type_ids=(ids == loaded.renderer.image_id).long(),
            ).logits
            whole = logits[0, :-1].log_softmax(-1).gather(1, ids[0, 1:, None])[:, 0]
            torch.testing.assert_close(got, whole[len(each.prompt_ids) - 1 :], atol=1e-4, rtol=0)


def test_batches_are_made_ahead_in_order_but_not_more_than_a_few() -> None:
    renderer, read = tiny_renderer(), list[str]()

    def picture(name: str) -> bytes:
        read.append(name)
        return PICTURES[name]

    made = [replace(sample(renderer, "a" * number), picture=picture) for number in range(1, 13)]
    found = batches_ahead([[each] for each in made], renderer, off_policy=False)
    for number, each in enumerate(made):
        batch = next(found)
        assert batch.targets.tolist() == each.reply_ids.tolist()
        wait_until(lambda: len(read) >= min(number + AHEAD, len(made)), 10)  # noqa: B023
        assert len(read) <= number + 1 + AHEAD
    with pytest.raises(StopIteration):
        next(found)

    def missing(_name: str) -> bytes:
        raise OSError("gone")

    broken = [[made[0]], [replace(made[0], picture=missing)], *[[each] for each in made]]
    found = batches_ahead(broken, renderer, off_policy=False)
    next(found)
    with pytest.raises(OSError, match="gone"):
        next(found)


def test_a_process_with_fewer_chunks_calls_the_head_as_often_as_the_others(
    model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Under ZeRO's stage 3 every call is one of all processes, forward and backward."""
    loaded = load_model(model)
    batch = collate(samples(BC)[:1], loaded.renderer, off_policy=False)
    calls: list[int] = []
    loaded.model.lm_head.register_forward_hook(lambda *_: calls.append(len(calls)))

    def gradient() -> tuple[torch.Tensor, torch.Tensor]:
        calls.clear()
        loaded.model.zero_grad()
        found = ReplyLogProbs(loaded.model, 4)(batch)
        found.sum().backward()
        return found.detach(), loaded.model.lm_head.weight.grad

    alone = gradient()
    assert len(calls) == 2 * 2
    monkeypatch.setattr(torch.distributed, "is_initialized", lambda: True)
    monkeypatch.setattr(torch.distributed, "all_reduce", lambda most, _: most.fill_(5))
    together = gradient()
    assert len(calls) == 2 * 5
    torch.testing.assert_close(together, alone)


def test_log_probabilities_for_importance_weights_are_at_the_temperature_of_sampling(model: Path) -> None:
    loaded = load_model(model)
    renderer = loaded.renderer
    two = [sample(renderer, "click", temperature=each, logprobs=torch.zeros(6)) for each in (1.0, 0.5)]
    with torch.no_grad():
        policy = ReplyLogProbs(loaded.model, 100)
        plain, sharp = policy(collate(two, renderer, off_policy=True)).split(6)
        same = policy(collate(two, renderer, off_policy=False)).split(6)
    assert not torch.allclose(plain, sharp)
    torch.testing.assert_close(same[0], same[1])


def test_training_makes_what_was_done_likelier_and_the_report_says_what_was_seen(
    model: Path, tmp_path: Path
) -> None:
    report = run_case("all_weights", model, tmp_path / "new")

    assert likelihood(tmp_path / "new") > likelihood(model) + 0.5
    made = samples(BC)
    assert report.samples == 7
    assert report.tokens == 2 * sum(len(each.reply_ids) for each in made)
    assert report.prompt_tokens == 2 * sum(len(each.prompt_ids) for each in made)
    assert report.optimizer_steps == 4
    assert report.learning_rate == pytest.approx(1e-2)


@pytest.mark.parametrize("case", ["all_weights", "groups"])
def test_micro_batches_give_the_update_of_the_whole_batch(model: Path, tmp_path: Path, case: str) -> None:
    one = run_case(case, model, tmp_path / "one", micro_batch=1)
    whole = run_case(case, model, tmp_path / "whole", micro_batch=100)
    assert_same(model, tmp_path / "one", tmp_path / "whole")
    assert one.loss == pytest.approx(whole.loss, abs=1e-5)
    assert one.extra == pytest.approx(whole.extra, abs=1e-4)


def of_trajectories(objective: GroupIS) -> list[Sample]:
    """The samples as steps of three trajectories, each with one advantage."""
    return [
        replace(each, trajectory=str(number % 3), advantage=0.05 * (number % 3 - 1.5))
        for number, each in enumerate(samples(objective))
    ]


@pytest.mark.parametrize("ratio", ["step", "sequence"])
def test_ratios_of_steps_and_trajectories_do_not_depend_on_micro_batches(
    model: Path, tmp_path: Path, ratio: str
) -> None:
    objective = GroupIS.model_validate({"ratio": ratio, "largest_weight": None, "clip_high": 0.01})
    reports = []
    for micro_batch in (1, 100):
        made = updater(model, objective, micro_batch=micro_batch, minibatches=2)
        reports.append(made.update(of_trajectories(objective), passes=3))
        made.save(tmp_path / str(micro_batch))
    assert_same(model, tmp_path / "1", tmp_path / "100")
    assert reports[0].extra == pytest.approx(reports[1].extra, abs=1e-3)
    assert reports[0].optimizer_steps == 6
    assert reports[0].extra["clipped_high"] > 0


def test_mini_batches_are_of_whole_trajectories_and_every_step_is_used(model: Path) -> None:
    objective = GroupIS()
    made, data = updater(model, objective, minibatches=2), of_trajectories(objective)
    batches = list(made._batches(data, 3))
    assert len(batches) == 6
    for first, second in zip(batches[::2], batches[1::2], strict=True):
        assert sorted([*first, *second]) == list(range(len(data)))
        assert {data[i].trajectory for i in first}.isdisjoint(data[i].trajectory for i in second)


@pytest.mark.parametrize("lora", [None, {"rank": 4, "alpha": 8}])
def test_a_kl_term_holds_the_policy_near_the_start(model: Path, lora: dict[str, int] | None) -> None:
    apart = []
    for kl in (0.0, 10.0):
        objective = GroupIS(kl=kl, largest_weight=None)
        made = updater(model, objective, lora=lora, learning_rate=3e-3, warmup_steps=0)
        first = made.update(of_trajectories(objective), passes=4)
        apart.append(made.update(of_trajectories(objective), passes=1).extra["kl_start"])
        assert first.extra["entropy"] > 0
    assert 0 < apart[1] < 0.5 * apart[0]


def test_the_start_is_that_of_the_training_also_after_a_resume(model: Path, tmp_path: Path) -> None:
    made = updater(model)
    assert made.update(samples(BC), passes=4).extra["kl_start"] > 1e-3
    made.save(tmp_path / "half")
    again = updater(model, resume=tmp_path / "half", learning_rate=1e-9)
    assert again.update(samples(BC)).extra["kl_start"] > 1e-3
    assert updater(model, learning_rate=1e-9).update(samples(BC)).extra["kl_start"] < 1e-6


def test_what_server_and_learner_make_of_the_same_weights_is_compared(model: Path) -> None:
    objective, made = GroupIS(), updater(model, GroupIS())
    data = samples(objective)
    now = made._logprobs(data, range(len(data)))
    served = [replace(each, logprobs=now[i] + 0.25, version="3") for i, each in enumerate(data)]
    stale = [replace(each, version="2") for each in data]
    report = made.update([*served, *stale], version="3")
    assert report.extra["logprob_mismatch"] == pytest.approx(0.25, abs=1e-4)
    assert "logprob_mismatch" not in made.update(stale, version="3").extra


@pytest.mark.parametrize("lora", [None, {"rank": 4, "alpha": 8}])
def test_recomputing_activations_gives_the_same_update(model: Path, lora: dict[str, int] | None) -> None:
    found = []
    for recomputes in (False, True):
        made = updater(model, lora=lora, gradient_checkpointing=recomputes)
        report = made.update(samples(BC)[:2])
        found.append((report.loss, report.grad_norm))
    assert found[0] == pytest.approx(found[1])


def test_the_launchers_accumulation_does_not_divide_the_loss(
    model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The update does it, whatever the environment says; and processes wait while the first one saves."""
    plain = updater(model).update(samples(BC)[:1])
    monkeypatch.setenv("ACCELERATE_GRADIENT_ACCUMULATION_STEPS", "4")
    made = updater(model)
    assert made.update(samples(BC)[:1]).grad_norm == pytest.approx(plain.grad_norm)
    assert made.accelerator.init_handler.timeout == SAVE_LIMIT


@pytest.mark.timeout(300)
def test_two_processes_give_the_update_of_one(model: Path, tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    cases = ["one_odd_batch", "adapters", "groups"]
    given = (port, model, tmp_path / "two", cases)
    processes = [process(run_cases_together, rank, *given) for rank in range(2)]
    for each in processes:
        each.start()
    for each in processes:
        each.join(240)
        each.kill()
    assert [each.exitcode for each in processes] == [0, 0]
    for case in cases:
        run_case(case, model, tmp_path / "one" / case)
        assert_same(model, tmp_path / "one" / case, tmp_path / "two" / case)
    learn_first(TrainConfig(learn=learning(model)), tmp_path / "alone")
    alone, together = (TrainingFolder(tmp_path / each).weights(1) for each in ("alone", "two/training"))
    assert_same(model, alone, together)


@pytest.mark.parametrize("lora", [None, {"rank": 4, "alpha": 8, "dropout": 0.3}])
def test_an_update_goes_on_from_disk_as_if_it_had_not_stopped(
    model: Path, tmp_path: Path, lora: dict[str, float] | None
) -> None:
    made = samples(BC)
    straight = updater(model, lora=lora)
    straight.update(made)
    straight.save(tmp_path / "half")
    straight.update(made)
    straight.save(tmp_path / "straight")

    again = updater(model, resume=tmp_path / "half", lora=lora)
    again.update(made)
    again.save(tmp_path / "again")

    assert_same(model, tmp_path / "straight", tmp_path / "again", tolerance=1e-6)
    assert read_state(tmp_path / "again").step == read_state(tmp_path / "straight").step == 2


def test_settings_that_were_edited_before_a_resume_apply_or_are_refused(model: Path, tmp_path: Path) -> None:
    lora = {"rank": 4, "alpha": 8}
    made = updater(model, lora=lora)
    made.update(samples(BC)[:1])
    made.save(tmp_path / "half")
    edited: dict[str, Any] = {"weight_decay": 0.5, "betas": (0.5, 0.6), "resume": tmp_path / "half"}
    again = updater(model, lora=lora | {"dropout": 0.5}, **edited)
    groups = [(group["weight_decay"], group["betas"]) for group in again.optimizer.param_groups]
    assert groups == [(0.5, (0.5, 0.6)), (0.0, (0.5, 0.6))]
    adapters = again.loaded.model.peft_config["default"]
    assert (adapters.lora_dropout, adapters.base_model_name_or_path) == (0.5, str(model))
    for name, value in (("rank", 8), ("alpha", 16), ("targets", ".*q_proj")):
        with pytest.raises(TrainingError, match=rf"was trained with update\.lora\.{name} .*, not "):
            updater(model, lora=lora | {name: value}, **edited)


def test_adapters_leave_the_weights_alone_and_load_as_a_model(model: Path, tmp_path: Path) -> None:
    run_case("adapters", model, tmp_path / "new")

    assert not (tmp_path / "new" / "model.safetensors").exists()
    assert all("lora" in name and "visual" not in name for name in weights(tmp_path / "new"))
    assert likelihood(tmp_path / "new") > likelihood(model) + 0.01


def test_saved_weights_have_what_a_servers_processor_reads(tmp_path: Path) -> None:
    source = write_tiny_model(tmp_path / "source")
    (source / "video_preprocessor_config.json").write_text('{"video_processor_type": "any"}')
    updater(source).save(tmp_path / "saved")
    copied = tmp_path / "saved" / "video_preprocessor_config.json"
    assert copied.read_text() == (source / copied.name).read_text()
    modes = {path.name: path.stat().st_mode for path in copied.parent.rglob("*") if path.is_file()}
    (tmp_path / "any").write_text("")
    assert set(modes.values()) == {(tmp_path / "any").stat().st_mode}, (
        "a server of another user can read them"
    )


def test_a_frozen_vision_tower_stays_as_it_was(model: Path, tmp_path: Path) -> None:
    run_case("all_weights", model, tmp_path / "new", freeze_vision=True)
    before, after = weights(model), weights(tmp_path / "new")
    for name, value in before.items():
        assert torch.equal(value, after[name]) is ("visual" in name)


def test_a_loss_that_is_no_number_stops_and_leaves_what_was_saved(model: Path, tmp_path: Path) -> None:
    made = updater(model)
    made.update(samples(BC))
    made.save(tmp_path / "good")
    poisoned = [replace(each, advantage=float("nan")) for each in samples(BC)]

    with pytest.raises(TrainingError, match="the loss of optimizer step 1 is nan") as error:
        made.update(poisoned)

    assert "\n" not in str(error.value)
    assert read_state(tmp_path / "good").step == 1
    assert sorted(each.name for each in tmp_path.iterdir()) == ["good"]


@pytest.mark.parametrize("poison", [float("nan"), float("inf")])
def test_weights_that_are_no_numbers_are_not_saved(model: Path, tmp_path: Path, poison: float) -> None:
    made = updater(model)
    with torch.no_grad():
        made.loaded.model.model.visual.patch_embed.proj.weight[0] = poison
    with pytest.raises(TrainingError, match="the weights after optimizer step 0 are not finite"):
        made.save(tmp_path / "bad")
    assert list(tmp_path.iterdir()) == []


def test_a_save_that_fails_leaves_what_was_there(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = updater(model)
    made.save(tmp_path / "kept")
    before = weights(tmp_path / "kept")
    made.update(samples(BC))

    monkeypatch.setattr(safetensors.torch, "save", full)
    with pytest.raises(StoreError, match="no space left"):
        made.save(tmp_path / "kept")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["kept"]
    assert all(torch.equal(value, before[name]) for name, value in weights(tmp_path / "kept").items())


def test_an_update_that_failed_leaves_no_gradients_to_the_next(model: Path) -> None:
    made, fresh = updater(model), updater(model)
    poisoned = [replace(each, advantage=float("nan")) for each in samples(BC)[:1]]
    with pytest.raises(TrainingError):
        made.update(poisoned)
    assert made.update(samples(BC)[:1]).grad_norm == pytest.approx(fresh.update(samples(BC)[:1]).grad_norm)


def test_a_learner_whose_save_failed_begins_from_what_was_saved(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config, folder = learning(model), TrainingFolder(tmp_path)
    replay = Replay(config.replay, BC)
    folder.iteration(1).mkdir(parents=True)
    replay.add(1, Made([trajectory(0)]).write(folder.run(1)))
    draw, learner = replay.draw(), Learner(config, BC)

    with monkeypatch.context() as patch:
        patch.setattr(safetensors.torch, "save", full)
        with pytest.raises(StoreError):
            learner.learn(1, draw, folder)
    learner.learn(1, draw, folder)
    assert read_state(folder.weights(1)).step == 1


def test_what_a_dead_process_left_is_swept(model: Path, tmp_path: Path) -> None:
    made = updater(model)
    (tmp_path / ".kept.new.tmp").mkdir()
    (tmp_path / ".kept.old.tmp").mkdir()
    made.save(tmp_path / "kept")
    made.save(tmp_path / "kept")
    assert [each.name for each in tmp_path.iterdir()] == ["kept"]


def test_from_a_run_folder_to_better_weights(model: Path, tmp_path: Path) -> None:
    """The way of the guide: replay, samples, update, weights that a policy loads."""
    renderer = tiny_renderer()
    done = trajectory(0, reply=Reply("the way", "p"))
    told = trajectory(1, changed=(), reply=stored(renderer, "click"))
    failed = trajectory(2, outcome=Outcome.FAILURE)
    run = Made([done, told, failed]).write(tmp_path / "run")
    replay = Replay(ReplayConfig(), BC)
    replay.add(0, run)
    drawn = replay.draw()
    made = updater(model)
    maker = SampleMaker(made.renderer)
    steps = (
        (run.trajectory(each.attempt_id).episode.steps[each.index], each.advantage) for each in drawn.steps
    )
    report = made.update(list(maker.make(steps, run.image)), passes=8)
    made.save(tmp_path / "new")

    assert (report.samples, maker.rebuilt, maker.stored) == (4, 3, 1)
    batch = collate([sample(renderer, "the way")], renderer, off_policy=False)
    likely = []
    for folder in (model, tmp_path / "new"):
        with torch.no_grad():
            likely.append(float(ReplyLogProbs(load_model(folder).model, 100)(batch).mean()))
    assert likely[1] > likely[0] + 0.5


def test_steps_of_attempts_that_were_set_aside_after_the_draw_are_counted(
    model: Path, tmp_path: Path
) -> None:
    config, folder = learning(model), TrainingFolder(tmp_path)
    attempts = [trajectory(number, reply=Reply("click", "p")) for number in range(2)]
    replay = Replay(config.replay, BC)
    replay.add(1, Made(attempts))
    folder.iteration(1).mkdir(parents=True)
    Made(attempts[:1]).write(folder.run(1))
    told = Learner(config, BC).learn(1, replay.draw(), folder)
    assert (told["samples"], told["dropped"]) == (3, {"gone": 3})


def test_why_every_step_was_dropped_is_said(model: Path, tmp_path: Path) -> None:
    config, folder, objective = learning(model), TrainingFolder(tmp_path), GroupIS()
    cut = stored(tiny_renderer(), "click", sampling={"top_k": 2})
    outcomes = (Outcome.SUCCESS, Outcome.FAILURE)
    attempts = [trajectory(number, reply=cut, outcome=each) for number, each in enumerate(outcomes)]
    replay = Replay(config.replay, objective)
    folder.iteration(1).mkdir(parents=True)
    replay.add(1, Made(attempts).write(folder.run(1)))
    with pytest.raises(TrainingError, match=r"all 6 steps were dropped: .*'altered_sampling': 6") as error:
        Learner(config, objective).learn(1, replay.draw(), folder)
    assert "without top-p and top-k" in error.value.hint


def test_what_does_not_fit_is_one_line(model: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot load the model"):
        updater(tmp_path / "nowhere")
    with pytest.raises(ConfigError, match=r"lora\.targets matches no module"):
        updater(model, lora={"targets": "nothing"})
    with pytest.raises(TrainingError, match="holds no update to resume from"):
        updater(model, resume=model)
    made = updater(model)
    made.save(tmp_path / "all")
    with pytest.raises(TrainingError, match="without adapters"):
        updater(model, resume=tmp_path / "all", lora={})
    with pytest.raises(ValueError, match="nothing to train on"):
        made.update([])


@pytest.mark.parametrize("device", ["none", "cpu"])
def test_deepspeed_has_its_settings_from_the_update_and_does_not_offload(device: str) -> None:
    held: dict[str, Any] = {"zero_optimization": {"stage": 2, "offload_optimizer": {"device": device}}}
    plugin = SimpleNamespace(hf_ds_config=HfDeepSpeedConfig(held), deepspeed_config=held)
    accelerator: Any = SimpleNamespace(num_processes=2, state=SimpleNamespace(deepspeed_plugin=plugin))
    config = UpdateConfig(micro_batch=3, max_grad_norm=0.5)
    if device != "none":
        with pytest.raises(ConfigError, match="offloading is not supported"):
            sharding.configure_zero(accelerator, config)
        return
    sharding.configure_zero(accelerator, config)
    assert (held["gradient_clipping"], held["train_micro_batch_size_per_gpu"]) == (0.5, 3)
    assert held["train_batch_size"] == 3 * 2 * held["gradient_accumulation_steps"] == 6


def test_the_learning_rate_warms_up_and_then_stays_or_falls() -> None:
    constant = UpdateConfig(learning_rate=1.0, warmup_steps=4)
    assert [learning_rate(constant, step) for step in (0, 1, 3, 4, 1000)] == pytest.approx(
        [0.2, 0.4, 0.8, 1, 1]
    )
    tenth = UpdateConfig(learning_rate=1.0, warmup_steps=4, schedule="cosine", total_steps=14, final_rate=0.1)
    assert [learning_rate(tenth, step) for step in (0, 4, 9, 14, 99)] == pytest.approx(
        [0.2, 1, 0.55, 0.1, 0.1]
    )
    cosine = UpdateConfig(learning_rate=1.0, warmup_steps=4, schedule="cosine", total_steps=14)
    assert [learning_rate(cosine, step) for step in (0, 4, 9, 14, 99)] == pytest.approx([0.2, 1, 0.5, 0, 0])


def test_bf16_is_close_to_float32(model: Path, tmp_path: Path) -> None:
    run_case("one_odd_batch", model, tmp_path / "bf16", precision="bf16")
    assert likelihood(tmp_path / "bf16") > likelihood(model) + 0.3
    assert weights(tmp_path / "bf16")["model.language_model.norm.weight"].dtype == torch.bfloat16
    made = updater(model, resume=tmp_path / "bf16", precision="bf16", batch=7)
    trained = made.loaded.model.model.language_model.norm.weight
    assert trained.dtype == torch.float32
    assert not torch.equal(trained, trained.bfloat16().float()), "training goes on from what was not rounded"
