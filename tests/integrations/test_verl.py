"""verl gets what its server sampled, an output per step, and none for an episode without a reward."""

from __future__ import annotations

import functools
import types
import warnings
from collections import Counter
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from tests.inference.tiny import tiny_renderer
from tests.integrations.conformance import check_in_browsers
from tests.integrations.engine import Engine, example, reply_text, texts_of

import webgym
from webgym import Action, Answer, RunConfig, Scroll
from webgym.testing import Adapted, Told, check_adapter, stand_in_pool

pytest.importorskip("verl", reason="verl is not installed")

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of its imports
    import hydra
    from omegaconf import OmegaConf
    from verl.experimental.agent_loop.agent_loop import AgentLoopOutput, DictConfigWrap, ToolListWrap
    from verl.utils.dataset.rl_dataset import RLHFDataset
    from verl.workers.rollout.replica import TokenOutput

    from webgym.integrations import verl
    from webgym.integrations.verl import WebGymAgentLoop, write_dataset

renderer = functools.cache(tiny_renderer)  # by the first test that needs it
RIGHT = (reply_text(Scroll("down")), reply_text(Answer("right")))
SAMPLING = {"temperature": 1.0, "top_p": 1.0, "top_k": -1, "repetition_penalty": 1.0, "logprobs": True}


class Server:
    """Speaks verl's types, and samples what it is told to."""

    def __init__(self, texts: Sequence[str] = RIGHT, ended: str = "completed") -> None:
        self._engine, self._texts, self._ended = Engine(renderer(), texts), texts, ended
        self.requests: list[dict[str, Any]] = []

    async def generate(self, request_id: str, **given: Any) -> TokenOutput:
        ids, logprobs = self._engine.sample(self._texts[len(self.requests)])
        self.requests.append({"id": request_id, **given})
        versions = {"min_global_steps": 6, "max_global_steps": 7}
        return TokenOutput(
            token_ids=ids, log_probs=logprobs, stop_reason=self._ended, num_preempted=0, extra_fields=versions
        )


def loop(
    server: Server, pool: webgym.EnvironmentPool | None = None, *, top_k: int = -1, **entry: Any
) -> WebGymAgentLoop:
    """As verl makes it of an entry in the file of agent loops, for every episode."""
    rollout = {"prompt_length": 8192, "response_length": 2048, **SAMPLING, "top_k": top_k}
    config = OmegaConf.create({"actor_rollout_ref": {"rollout": rollout}, "data": {}})
    made: WebGymAgentLoop = hydra.utils.instantiate(
        {"_target_": "webgym.integrations.verl.WebGymAgentLoop", **entry},
        trainer_config=DictConfigWrap(config),
        server_manager=server,
        tokenizer=renderer().tokenizer,
        processor=types.SimpleNamespace(image_processor=renderer().image_processor),
        hf_model_type="qwen3_vl",
        dataset_cls=RLHFDataset,
        data_config=DictConfigWrap(config.data),
        tools=ToolListWrap([]),
        **({} if pool is None else {"pool": pool}),
    )
    return made


async def played(folder: Path, server: Server, **more: Any) -> list[AgentLoopOutput]:
    async with webgym.EnvironmentPool(**stand_in_pool(folder, **more)) as pool:
        return await loop(server, pool).run(SAMPLING, extra_info={"task_id": "check-3"})


@asynccontextmanager
async def adapter(given: dict[str, Any]) -> AsyncIterator[Adapted]:
    async with webgym.EnvironmentPool(**given) as pool:

        async def play(task_id: str, actions: Sequence[Action | str]) -> Told:
            outputs = await loop(Server(texts_of(actions)), pool).run(SAMPLING, task_id=task_id)
            return Told([output.reward_score for output in outputs])

        yield Adapted(play)


async def test_it_keeps_the_environments_promises(tmp_path: Path) -> None:
    def rows(name: str, config: RunConfig) -> list[str]:
        write_dataset(tmp_path / "drawn.parquet", name, split="all", count=6, config=config)
        read = pq.read_table(tmp_path / "drawn.parquet").to_pylist()
        return [row["extra_info"]["task_id"] for row in read]

    assert await check_adapter(adapter, rows=rows) == []


@pytest.mark.browser
async def test_in_real_browsers() -> None:
    assert [set(told.final) for told in await check_in_browsers(adapter)] == [{1.0}, {0.0}]


async def test_an_episode_is_outputs_of_what_was_sampled(tmp_path: Path) -> None:
    server = Server()
    outputs = await played(tmp_path, server)
    assert len(outputs) == 2
    for output, request, text in zip(outputs, server.requests, RIGHT, strict=True):
        ids, logprobs = server._engine.sample(text)
        assert output.prompt_ids == request["prompt_ids"]
        assert output.response_ids == ids
        assert output.response_mask == [1] * len(ids)
        assert output.response_logprobs == pytest.approx(logprobs)
        assert output.reward_score == 1.0
        assert output.extra_fields["max_global_steps"] == 7
        assert output.extra_fields["reward_extra_info"]["outcome"] == "success"
        assert output.multi_modal_data is not None
        sent, kept = request["image_data"], output.multi_modal_data["images"]
        assert [each.tobytes() for each in sent] == [each.tobytes() for each in kept]
        assert output.as_dict()["rollout_log_probs"].shape == (len(ids),)
    assert len({request["id"] for request in server.requests}) == 1


async def test_steps_that_do_not_hold_together_are_dropped_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verl, "dropped", Counter())
    wrong = tuple(f"<|image_pad|>{text}" for text in RIGHT)  # an image token without a picture
    batch = await played(tmp_path, Server((wrong[0], RIGHT[1])))
    batch += await played(tmp_path, server := Server())
    infos = [output.extra_fields["reward_extra_info"] for output in batch]
    assert [info["dropped"] for info in infos] == [1, 0, 0]
    sampled = [server._engine.sample(text)[0] for text in (RIGHT[1], *RIGHT)]
    assert [output.response_ids for output in batch] == sampled
    assert {tuple(info) for info in infos} == {("outcome", "task_id", "dropped")}  # verl reads all by one's
    assert await played(tmp_path, Server(wrong)) == []
    assert verl.dropped == {"image_in_reply": 3}


async def test_replies_of_another_distribution_may_be_validated_and_not_trained_on(tmp_path: Path) -> None:
    async with webgym.EnvironmentPool(**stand_in_pool(tmp_path)) as pool:
        altered = SAMPLING | {"top_k": 20}
        assert await loop(Server(), pool, top_k=20).run(altered, task_id="check-3") == []
        assert len(await loop(Server(), pool).run(altered, task_id="check-3")) == 2


@pytest.mark.parametrize("fault", [{"fails": True}, {"fault": "judge"}, {"fault": "blocked"}])
async def test_an_episode_without_a_reward_gives_nothing(tmp_path: Path, fault: dict[str, Any]) -> None:
    counted = verl.dropped["no_reward"]
    assert await played(tmp_path, Server(), **fault) == []
    assert verl.dropped["no_reward"] > counted


async def test_a_reply_that_the_engine_aborted_is_no_action_of_the_agents(tmp_path: Path) -> None:
    """The episode would end as a failure: its answer is cut off."""
    wrong = (RIGHT[0], "Action: wa")
    assert len(await played(tmp_path / "a", Server(wrong * 9))) > 0
    assert await played(tmp_path / "b", Server(wrong * 9, "aborted")) == []


async def test_episodes_of_the_same_entry_share_their_browsers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verl, "_pools", {})
    entry: dict[str, Any] = {"tasks": "offline-small-v2", "size": 3}
    one, other = (loop(Server(), **entry) for _ in range(2))
    assert one._pool is other._pool
    assert list(verl._pools) == [("offline-small-v2", 3, "train")]
    assert loop(Server(), **entry, split="test")._pool is not one._pool


def test_the_dataset_holds_nothing_that_judges_see(tmp_path: Path) -> None:
    given = stand_in_pool(tmp_path)
    write_dataset(tmp_path / "train.parquet", given["name"], split="all", count=3)
    rows = pq.read_table(tmp_path / "train.parquet").to_pylist()
    assert len(rows) == 3
    assert rows[0].keys() == {"prompt", "data_source", "agent_name", "reward_model", "extra_info"}
    assert rows[0]["reward_model"]["ground_truth"] == ""


def test_the_example(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example("verl_files").main(tmp_path / "data", "offline-small-v2", size=2, count=3)
    entries = OmegaConf.load(tmp_path / "data" / "agent_loop.yaml")
    for split, entry in zip(("train", "test"), entries, strict=True):
        rows = pq.read_table(tmp_path / "data" / f"{split}.parquet").to_pylist()
        assert [row["agent_name"] for row in rows] == [entry["name"]] * 3
        assert entry["split"] == split
        assert hydra.utils.get_class(entry["_target_"]) is WebGymAgentLoop
    assert f"agent_loop_config_path={tmp_path}/data/agent_loop.yaml" in capsys.readouterr().out
