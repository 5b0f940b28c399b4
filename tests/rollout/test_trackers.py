"""What TensorBoard and Weights & Biases are given is what metrics.jsonl holds."""

from __future__ import annotations

import json
import sys
import threading
import types
from pathlib import Path
from typing import Any

import pytest
from tests.rollout.running import small_run
from tests.train.making import Made, trajectory

from webgym.core.errors import ConfigError
from webgym.core.outcome import Outcome
from webgym.rollout.trackers import FOLDER, numbers_in, tracking
from webgym.run.collect import collect, resume
from webgym.run.config import RunConfig


def row(iteration: int, rate: float | None) -> dict[str, Any]:
    return {
        "iteration": iteration,
        "collect": {
            "success_rate": {"overall": rate, "easy": None},
            "success_interval": {"overall": [0.1, 0.4]},
        },
        "update": {"loss": 0.5, "dropped": {"request too long": 2}},
        "seconds": {"update": 3.0},
        "evaluation": None,
        "judge": "offline",
        "is_last": True,
    }


def test_numbers_are_told_by_their_path_and_nothing_else_is() -> None:
    assert dict(numbers_in(row(3, 0.25))) == {
        "iteration": 3,
        "collect/success_rate/overall": 0.25,
        "collect/success_interval/overall/low": 0.1,
        "collect/success_interval/overall/high": 0.4,
        "update/loss": 0.5,
        "update/dropped/request too long": 2,
        "seconds/update": 3.0,
    }


def scalars(path: Path) -> dict[str, list[tuple[int, float]]]:
    from tensorboard.backend.event_processing.event_accumulator import (  # type: ignore[import-untyped]
        EventAccumulator,
    )

    found = EventAccumulator(str(path / FOLDER))
    found.Reload()
    return {
        name: [(each.step, each.value) for each in found.Scalars(name)] for name in found.Tags()["scalars"]
    }


def test_tensorboard_shows_when_figures_were_measured(tmp_path: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    with tracking(["tensorboard"], tmp_path, "webgym", [row(1, 0.25) | {"at": 1_000.5}], print):
        pass
    found = EventAccumulator(str(tmp_path / FOLDER))
    found.Reload()
    assert [each.wall_time for each in found.Scalars("update/loss")] == [1_000.5]


def texts(path: Path) -> dict[str, list[str]]:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
    from tensorboard.util.tensor_util import make_ndarray  # type: ignore[import-untyped]

    found = EventAccumulator(str(path / FOLDER))
    found.Reload()
    return {
        name.removesuffix("/text_summary"): [
            make_ndarray(each.tensor_proto)[0].decode() for each in found.Tensors(name)
        ]
        for name in found.Tags()["tensors"]
    }


def test_tensorboard_shows_every_iteration_once_also_after_a_resume(tmp_path: Path) -> None:
    with tracking(["tensorboard"], tmp_path, "webgym", [], print) as track:
        track(row(1, 0.25))
        track(row(2, 0.75))  # killed before this came to metrics.jsonl, say
    with tracking(["tensorboard"], tmp_path, "webgym", [row(1, 0.25)], print) as track:
        track(row(2, 0.5))
    found = scalars(tmp_path)
    assert found["collect/success_rate/overall"] == [(1, 0.25), (2, 0.5)]
    assert "collect/success_rate/easy" not in found
    assert found["update/dropped/request too long"] == [(1, 2.0), (2, 2.0)]


async def test_a_run_tells_what_its_metrics_hold_also_after_a_resume(tmp_path: Path) -> None:
    config = small_run(3, trackers=("tensorboard",))
    for go_on in (collect(config, tmp_path / "run"), resume(tmp_path / "run")):
        await go_on
        lines = (tmp_path / "run/metrics.jsonl").read_text().splitlines()
        rows = [json.loads(line) for line in lines]
        done = scalars(tmp_path / "run")["done"]
        assert done == [(number, row["done"]) for number, row in enumerate(rows, 1)]
    notes = {row["note"] for row in rows}
    assert notes == {"the scripted policy is an oracle: it plays known solutions and uses no model"}
    assert texts(tmp_path / "run") == {"note": [*notes]}
    assert done[-1] == (len(rows), 3)


async def test_a_run_without_its_tracker_leaves_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match="TensorBoard is not installed"):
        await collect(RunConfig(trackers=("tensorboard",)), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_weights_and_biases_is_given_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[dict[str, Any]] = []
    logged: list[tuple[int, dict[str, float]]] = []
    ended: list[bool] = []
    run = types.SimpleNamespace(
        log=lambda numbers, step: logged.append((step, numbers)), finish=lambda: ended.append(True)
    )

    def init(**options: Any) -> Any:
        asked.append(options)
        return run

    monkeypatch.setitem(sys.modules, "wandb", types.SimpleNamespace(init=init))
    for _ in range(2):
        with tracking(["wandb"], tmp_path / "first", "study", [row(1, 0.25)], print) as track:
            track(row(2, 0.5) | {"note": "an oracle"})
    assert run.notes == "an oracle"
    assert [step for step, _ in logged] == [1, 2, 1, 2]
    assert logged[1][1]["collect/success_rate/overall"] == 0.5
    assert asked[0] == asked[1], "a training that goes on is the same run"
    assert (asked[0]["project"], asked[0]["name"], asked[0]["resume"]) == ("study", "first", "allow")
    assert ended == [True, True]


def training(path: Path) -> dict[str, Any]:
    """A training's folder with one iteration of two attempts, and its row of the metrics."""
    run = Made(
        [trajectory(0), trajectory(1, outcome=Outcome.FAILURE), trajectory(2, outcome=Outcome.BLOCKED)]
    )
    (path / "iterations/0001").mkdir(parents=True)
    run.write(path / "iterations/0001/run")
    return row(1, 0.5) | {"trajectories": 3}


def test_weights_and_biases_has_a_named_axis_and_a_table_of_attempts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stand-in at its API: ``define_metric``, ``Table``, ``Image``."""
    axes: list[Any] = []
    logged: list[dict[str, Any]] = []

    class Table:
        def __init__(self, columns: list[str]) -> None:
            self.columns, self.rows = columns, list[tuple[Any, ...]]()

        def add_data(self, *values: Any) -> None:
            assert len(values) == len(self.columns)
            self.rows.append(values)

    run = types.SimpleNamespace(
        log=lambda numbers, step: logged.append(numbers),
        finish=lambda: None,
        define_metric=lambda name, step_metric=None: axes.append((name, step_metric)),
    )
    stand_in = types.SimpleNamespace(init=lambda **_: run, Table=Table, Image=lambda path: Path(path))
    monkeypatch.setitem(sys.modules, "wandb", stand_in)
    with tracking(["wandb"], tmp_path, "p", [training(tmp_path)], print) as track:
        track(row(2, 0.5) | {"trajectories": 6})
    assert axes == [("trajectories", None), ("*", "trajectories")]
    table = logged[0]["attempts"]
    assert [(values[1], values[2]) for values in table.rows] == [("success", 3), ("failure", 3)]
    assert all(picture.is_file() for values in table.rows for picture in values[4:])
    assert "attempts" not in logged[1]


def test_the_real_weights_and_biases_takes_them_offline(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("wandb")
    monkeypatch.setenv("WANDB_MODE", "offline")
    told: list[str] = []
    with tracking(["wandb"], tmp_path, "p", [training(tmp_path)], told.append) as track:
        track(row(2, 0.5) | {"trajectories": 6})
    assert told == []
    [table] = tmp_path.glob("wandb/offline-run-*/files/media/table/attempts_*.json")
    # The pictures themselves are in its artifact.
    assert json.loads(table.read_text())["data"] == [
        ["find it", "success", 3, "click", "Image", "Image"],
        ["find it", "failure", 3, "click", "Image", "Image"],
    ]


async def test_a_tracker_that_fails_or_hangs_stops_nothing_and_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hangs, told = threading.Event(), list[str]()

    def log(numbers: dict[str, float], step: int) -> None:
        del numbers, step
        assert hangs.wait(60)
        raise RuntimeError("402\nnot paid")

    given = types.SimpleNamespace(log=log, finish=lambda: None)
    monkeypatch.setitem(sys.modules, "wandb", types.SimpleNamespace(init=lambda **_: given))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: name)
    with tracking(["wandb"], tmp_path, "p", [], told.append) as track:
        for number in range(3):
            track(row(number, 0.5))
        hangs.set()
    assert told == [
        "wandb gets no more figures until this is resumed with --resume: RuntimeError: 402 not paid"
    ]
    config = small_run(3, trackers=("wandb",))
    lines: list[str] = []
    summary = await collect(config, tmp_path / "run", tell=lines.append)
    assert summary["outcomes"]["success"] == 3
    assert told[0] in lines


@pytest.mark.parametrize("where", ["log", "finish"])
def test_a_tracker_that_hangs_does_not_hold_the_end(
    where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hangs, told = threading.Event(), list[str]()
    calls = {"log": lambda **_: None, "finish": lambda: None} | {where: lambda *_, **__: hangs.wait(60)}
    given = types.SimpleNamespace(log=lambda numbers, step: calls["log"](), finish=calls["finish"])
    monkeypatch.setitem(sys.modules, "wandb", types.SimpleNamespace(init=lambda **_: given))
    monkeypatch.setattr("webgym.rollout.trackers.CLOSE_SECONDS", 0.05)
    with tracking(["wandb"], tmp_path, "p", [row(1, 0.5)], told.append):
        pass
    assert not hangs.is_set(), "the block ended while the tracker hung"
    assert told == [
        "wandb gets no more figures until this is resumed with --resume: it did not end within 0.05 s"
    ]
    hangs.set()


def test_a_tracker_that_is_not_installed_or_does_not_start_is_said_in_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "wandb", None)
    with (
        pytest.raises(ConfigError, match=r"not installed .*pip install wandb"),
        tracking(["wandb"], tmp_path, "p", [], print),
    ):
        pass

    def init(**_: Any) -> Any:
        raise RuntimeError("no\nAPI key")

    monkeypatch.setitem(sys.modules, "wandb", types.SimpleNamespace(init=init))
    with (
        pytest.raises(ConfigError, match=r"no API key .*offline"),
        tracking(["wandb"], tmp_path, "p", [], print),
    ):
        pass
