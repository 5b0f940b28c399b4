"""First weights: static pages look as in browsers, and the recipe continues where it was killed."""

from __future__ import annotations

import asyncio
import io
import json
import math
import os
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from PIL import Image
from tests.conftest import Calls
from tests.documented import ROOT, documented

pytest.importorskip("torch")

from webgym.core.errors import ConfigError, StoreLocked
from webgym.core.outcome import Outcome
from webgym.core.settings import load_settings
from webgym.offline.web import OfflineWeb
from webgym.rollout.config import AttemptConfig
from webgym.rollout.plan import Planned
from webgym.run.collect import collect
from webgym.run.config import RunConfig
from webgym.store.files import take_lock
from webgym.store.runs import RunReader
from webgym.study import recipe
from webgym.study.demonstrators import Demonstrators
from webgym.study.recipe import RecipeConfig, agent_of, follow
from webgym.study.static_browsers import StaticBrowsers, StaticCollector

pytestmark = pytest.mark.browser


def pixels(png: bytes) -> Any:
    with Image.open(io.BytesIO(png)) as picture:
        return np.asarray(picture.convert("RGB")).astype(np.int16)


def test_static_browsers_give_what_browsers_give(tmp_path: Path) -> None:
    """Requests, replies, pictures and changes of the same attempts, without and with browsers."""
    config = RunConfig.model_validate(
        {
            "seed": 3,
            "sites": {"collection": "small", "latency": 0, "per_family": 6},
            "agent": {"prompt_format": "compact", "rounds": 0, "profile": "tiny"},
            "tasks": {"split": "train", "count": 3},
            "collector": {"sessions": 2},
        }
    )

    async def both() -> None:
        await collect(config, tmp_path / "run", policy=Demonstrators())
        run, web = RunReader(tmp_path / "run"), OfflineWeb(7, per_family=6, collection="small")
        async with StaticBrowsers(web, tmp_path / "pictures") as browsers:
            assert browsers.page_images is not None
            agent = agent_of(Demonstrators())
            collectors = StaticCollector(browsers, agent, AttemptConfig(), config.seed)
            for made in run.trajectories():
                task = run.tasks[made.episode.task_id]
                static = await collectors.make(Planned(task, made.episode.sample))
                drawn = browsers.page_images.pictures()
                assert static.answer == made.episode.answer
                assert static.final_state == made.episode.final_state
                assert static.seed == made.episode.seed
                for ours, theirs in zip(static.steps, made.episode.steps, strict=True):
                    assert ours.reply.text == theirs.reply.text
                    assert ours.changed == theirs.changed
                    assert texts(ours.messages) == texts(theirs.messages)
                    png = run.image(theirs.observation.screenshot)
                    differs = np.abs(pixels(drawn[ours.observation.screenshot]) - pixels(png))
                    assert differs.mean() < 0.05  # edges of rounded shapes, by a shade

    asyncio.run(both())


class Killed(Exception):
    """In place of a signal."""


def texts(messages: Any) -> list[str]:
    return [part.text for message in messages for part in message.content if hasattr(part, "text")]


def test_a_recipe_that_was_killed_ends_with_the_same_weights(
    tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.study.pretrain.CHECKPOINT_STEPS", 2)
    monkeypatch.setattr("webgym.study.pretrain.REPORT_STEPS", 1)
    monkeypatch.setattr("webgym.study.recipe.EXAMINED", 1)
    monkeypatch.setattr("webgym.cli._print.LINE_SECONDS", 0)
    small = {"width": 32, "text_layers": 1, "vision_layers": 2}
    taught = {"model": small, "steps": 6, "pointing_steps": 3, "batch": 2, "threads": 1}
    (tmp_path / "small.yaml").write_text(
        json.dumps(
            {
                "attempts": 3,
                "per_family": 6,
                "budget": [2, 2, 2],
                "pretrain": taught,
            }
        )
    )
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    monkeypatch.chdir(tmp_path)
    settings = [Path("configs/tiny/recipe.yaml"), Path("small.yaml")]
    config = load_settings(RecipeConfig, settings, hint="")
    told: list[int] = []

    def tell(figures: Any) -> None:
        told.append(figures["step"])

    def killed(figures: Any) -> None:
        if figures["step"] == 5:
            raise Killed

    def advance(what: str, done: int, of: int) -> None:
        assert 0 < done <= of, what

    pretrain = documented("webgym pretrain configs/tiny/recipe.yaml --out tiny")
    code, said = calls.run(*pretrain, "small.yaml", "--out", "whole")
    assert code == 0, said
    assert "pretraining: 6 of 6 loss" in said
    assert "examination: 1 of 1" in said
    figures = [json.loads(line) for line in Path("whole/metrics.jsonl").read_text().splitlines()]
    assert [each["step"] for each in figures] == [1, 2, 3, 4, 5, 6]
    with pytest.raises(Killed):
        asyncio.run(follow(config, tmp_path / "killed", tell=killed, advance=advance))
    del told[:]
    faster = config.model_copy(update={"pretrain": config.pretrain.model_copy(update={"decay_share": 0.5})})
    for name in ("whole", "killed"):  # a model, and a checkpoint
        with pytest.raises(ConfigError, match=f"the model in .*{name} was made with other settings"):
            asyncio.run(follow(faster, tmp_path / name, tell=tell, advance=advance))
    again = asyncio.run(follow(config, tmp_path / "killed", tell=tell, advance=advance))
    assert told == [5, 6]  # it went on from the checkpoint after update 4
    assert set(again) == {"train", "test"}
    for name in ("whole", "killed"):
        assert json.loads((tmp_path / name / "examination.json").read_text()) == json.loads(
            msgspec.json.encode(again)
        )
    weights = [tmp_path / name / "model/model.safetensors" for name in ("whole", "killed")]
    assert weights[0].read_bytes() == weights[1].read_bytes()
    other = config.model_copy(update={"attempts": 4})
    with pytest.raises(ConfigError, match=r"demonstrations\.msgpack was made with other settings"):
        asyncio.run(follow(other, tmp_path / "whole", tell=tell, advance=advance))


def test_what_the_command_prints_and_writes_is_right(
    tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcomes = dict.fromkeys(Outcome, 0) | {Outcome.TRUNCATED: 1, Outcome.POLICY_ERROR: 3}
    figures = {
        "attempts": 4,
        "outcomes": outcomes,
        "success_rate": {"overall": 0.0, "easy": 0.0, "medium": None, "hard": None},
        "success_interval": {"overall": (0.0, 0.793)},
    }

    async def followed(_: RecipeConfig, out: Path, *, tell: Any, **__: Any) -> dict[str, Any]:
        with pytest.raises(StoreLocked, match="is writing to"):
            take_lock(out)
        tell({"step": 1, "pointing": 1.5, "acting": math.nan})
        return {"train": figures}

    monkeypatch.setattr(recipe, "follow", followed)
    code, said = calls.run("pretrain", "--out", tmp_path)
    assert code == 0, said
    assert "train, 4 attempts: success 0.0% (0.0% to 79.3%) of 1 judged attempts, easy 0.0%" in said
    assert '"acting":null' in (tmp_path / "metrics.jsonl").read_text()
    lock = take_lock(tmp_path)
    for command in ("pretrain", "study"):
        code, said = calls.run(command, "--out", tmp_path)
        assert code == 1
        assert "is writing to" in said
    os.close(lock)
    (tmp_path / "config.yaml").touch()
    code, said = calls.run("pretrain", "--out", tmp_path)
    assert code == 2
    assert "holds a run or a training already" in said
