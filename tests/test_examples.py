"""What users copy works: the examples run, the presets load."""

from __future__ import annotations

import ast
import io
import re
import runpy
import sys
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest
from PIL import Image
from tests.documented import documented

import webgym
from webgym.cli._run import settings
from webgym.core.trajectory import ImageRef, Message, TextPart
from webgym.judge.factory import refuse_unjudgeable
from webgym.offline.web import OfflineWeb
from webgym.tasks.sources import SOURCES
from webgym.taskset.construction.config import read_config

ROOT = Path(__file__).parent.parent


ONE_SCREEN = ROOT / "examples" / "train_on_one_screen.py"


@pytest.mark.browser
@pytest.mark.parametrize(
    "example", sorted({*(ROOT / "examples").glob("*.py")} - {ONE_SCREEN}), ids=lambda path: path.stem
)
def test_an_example_runs(
    example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As they are, but with fewer websites and browsers."""
    make_many = webgym.make_many
    few: dict[str, Any] = {"sites": {"per_family": 5}, "collector": {"sessions": 2}}
    monkeypatch.setattr(webgym, "make_many", lambda _, name: make_many(2, name))
    monkeypatch.setattr(webgym, "RunConfig", partial(webgym.RunConfig, **few))
    monkeypatch.setattr(sys, "argv", [str(example), str(tmp_path / "run")])
    runpy.run_path(str(example), run_name="__main__")
    assert "attempts" in capsys.readouterr().out


@pytest.mark.browser
def test_the_loop_on_one_screen_collects_learns_and_evaluates(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("torch")
    few = ["--iterations", "1", "--tasks", "3", "--test", "2"]
    command = documented("python examples/train_on_one_screen.py --seed 1")
    monkeypatch.setattr(sys, "argv", [str(ONE_SCREEN), *command, *few])
    runpy.run_path(str(ONE_SCREEN), run_name="__main__")
    before, learned, after = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"before  \d+\.\d % of 2 unseen tasks", before)
    assert re.search(r"% of 12 attempts at training tasks; (loss .* steps|nothing to compare)", learned)
    assert re.fullmatch(r"after   \d+\.\d % of 2 unseen tasks", after)


def test_the_loop_on_one_screen_makes_likelier_what_went_better_than_the_rest_of_its_group() -> None:
    torch = pytest.importorskip("torch")
    loop = runpy.run_path(str(ONE_SCREEN), run_name="loop")
    model = loop["load_model"](loop["WEIGHTS"])
    question = (ImageRef("page", 192, 128), TextPart("task say the number of the red star"))
    request = model.renderer.prompt((Message("user", question),), {"page": _page()})
    replies = loop["generate"](model, [request] * 2, [1, 2], loop["EXPLORE"])
    assert replies[0].ids != replies[1].ids
    attempts = [
        loop["Attempt"](None, task, {}, reward, [(request, reply)])
        for task, reward, reply in (
            ("mixed", 1.0, replies[0]),
            ("mixed", 0.0, replies[1]),
            ("all right", 1.0, replies[0]),
            ("all right", 1.0, replies[1]),
        )
    ]
    turns = list(loop["compared"](attempts))
    assert [advantage for _, _, advantage in turns] == pytest.approx([0.5**0.5, -(0.5**0.5)])

    def likelihoods() -> list[float]:
        with torch.no_grad():
            return [float(loop["log_probabilities"](model, [turn]).sum()) for turn in turns]

    before = likelihoods()
    recorded = [sum(reply.logprobs) for reply in replies]
    assert before == pytest.approx(recorded, abs=1e-3), "what was sampled has the probability that it had"
    optimizer = torch.optim.SGD(model.model.parameters(), lr=1e-3)
    loop["surrogate"](model, turns).backward()
    optimizer.step()
    good, bad = likelihoods()
    assert good > before[0]
    assert bad < before[1]


def _page() -> bytes:
    out = io.BytesIO()
    Image.new("RGB", (192, 128), "white").save(out, "PNG")
    return out.getvalue()


PAGES = [(ROOT / "docs" / name).read_text() for name in ("own-website.md", "tiny-policy.md")]
DOCUMENTED = re.findall(r"\.\. auto\w+:: (webgym\.\S+)", "".join(PAGES))


@pytest.mark.parametrize("example", sorted((ROOT / "examples").rglob("*.py")), ids=lambda path: path.stem)
def test_an_example_imports_what_may_be_relied_on(example: Path) -> None:
    imported = set[str]()
    for node in ast.walk(ast.parse(example.read_text())):
        match node:
            case ast.ImportFrom(module=str(module), names=names):
                imported |= {f"{module}.{each.name}" for each in names}
            case ast.Import(names=names):
                imported |= {each.name for each in names}
    public = {"webgym", *(f"webgym.{name}" for name in webgym.__all__), *DOCUMENTED}
    assert [
        name
        for name in sorted(imported)
        if re.match(r"webgym\b", name)
        and name not in public
        and not re.match(r"webgym\.(integrations|testing)\.", name)
    ] == []


TASK_SET = ROOT / "configs" / "task-set.yaml"
RUNS = sorted(set((ROOT / "configs").glob("*.yaml")) - {TASK_SET})


@pytest.mark.parametrize("preset", RUNS, ids=lambda path: path.stem)
def test_a_preset_of_a_run_loads(preset: Path) -> None:
    config = settings([preset], {})
    assert config.policy.name == "openai"
    assert "split" in config.tasks.model_fields_set
    # Tasks of a task set have no hidden truth: the preset's judge must do without.
    task = next(iter(OfflineWeb(1, per_family=1).tasks()))
    refuse_unjudgeable(config.judge, [msgspec.structs.replace(task, truth=None)])


def test_the_preset_of_the_task_set_names_all_its_sources() -> None:
    assert set(read_config(TASK_SET, {}).sources) == set(SOURCES) - {"webgym"}
