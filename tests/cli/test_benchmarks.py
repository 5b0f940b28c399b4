"""``webgym eval`` on a benchmark's public file, and by the benchmarks' judges."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse
from starlette.routing import Route
from tests.conftest import Calls
from tests.judge.judge_model import JudgeModel, serve_judge
from tests.judge.test_published import webjudge
from tests.llm.endpoint import Endpoint, serve
from tests.rollout.test_attempt import answers
from tests.serving import beside, serving

from webgym.judge.prompts import DIGEST
from webgym.judge.published import WebJudge
from webgym.results.evaluation import FEW_WEBSITES, evaluate
from webgym.run.config import RunConfig
from webgym.store.runs import RunReader
from webgym.store.verdicts import read_verdicts
from webgym.tasks.benchmarks import BENCHMARKS, BenchmarkName, read_benchmark

DATA = Path(__file__).resolve().parents[3] / "shared/data"


@pytest.fixture
def judge_model() -> Iterator[JudgeModel]:
    with beside(serve_judge(webjudge())) as model:
        yield model


@pytest.mark.parametrize(
    ("name", "file", "levels"),
    [
        ("online-mind2web", "online-mind2web/Online_Mind2Web_06042025.json", [83, 143, 74]),
        ("webvoyager", "webvoyager/WebVoyager_data.jsonl", [643, 0, 0]),
        ("deepshop", "deepshop/deepshop_test.jsonl", [50, 50, 50]),
        ("mind2web-live", "mind2web-live/mind2web-live_test_20241024.json", [104, 0, 0]),
        ("webgym-test", "webgym-format/webgym_format_samples.jsonl", [2, 0, 0]),
    ],
)
@pytest.mark.skipif(not DATA.exists(), reason=f"{DATA} is not there")
def test_the_public_files_as_they_are(name: BenchmarkName, file: str, levels: list[int]) -> None:
    read = read_benchmark(name, DATA / file)
    assert not read.broken
    assert [sum(task.level == level for task in read.tasks) for level in ("easy", "medium", "hard")] == levels


def test_what_gives_no_task_is_told_and_the_rest_is_read(tmp_path: Path) -> None:
    file = tmp_path / "om2w.json"
    whole = {"task_id": "a", "confirmed_task": "Find it.", "website": "https://a.example/", "level": "Hard"}
    records = [whole, whole | {"task_id": "b", "website": ""}, {"task_id": "c", "confirmed_task": None}]
    file.write_text(json.dumps(records, indent=1))
    read = read_benchmark("online-mind2web", file)
    (only,) = read.tasks
    assert (only.id, only.level, only.difficulty) == ("online-mind2web/a", "hard", 1)
    reasons = {str(each).removeprefix(f"{file}:") for each in read.broken}
    assert "online-mind2web/b: it has no website to start on" in reasons
    assert any("'confirmed_task' is empty" in reason for reason in reasons)


def test_a_deepshop_task_is_judged_by_the_requirements_of_its_record(tmp_path: Path) -> None:
    file = tmp_path / "deepshop.jsonl"
    record = {"web_name": "Amazon", "id": "Amazon--1", "ques": "Buy.", "web": "https://shop.example/"}
    record |= {"attribute": "a lamp", "filter": "None", "sort": "the cheapest", "difficulty": "medium"}
    file.write_text(json.dumps(record))
    (only,) = read_benchmark("deepshop", file).tasks
    assert [(group.description, fact) for group, _, fact in only.rubric.facts()] == [
        ("attribute", "a lamp"),
        ("sort", "the cheapest"),
    ]
    assert only.level == "medium"


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmarks_own_judge_decides_unless_another_is_named(name: BenchmarkName) -> None:
    tasks = {"benchmark": name, "file": "x.json"}
    assert RunConfig.model_validate({"tasks": tasks}).judge.name == BENCHMARKS[name].judge
    named = RunConfig.model_validate({"tasks": tasks, "judge": {"name": "offline"}})
    assert named.judge.name == "offline"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--benchmark", "webvoyager"), "the benchmark webvoyager needs its public file"),
        (("--benchmark", "gaia", "--file", "x"), "Input should be 'online-mind2web'"),
        (("--benchmark", "deepshop", "--file", "x", "--tasks", "y"), "--tasks and --file exclude each other"),
        (("--benchmark", "webvoyager", "--file", "missing.jsonl"), "cannot read missing.jsonl"),
        (("--benchmark", "webvoyager", "--file", "tasks.jsonl"), "the webvoyager judge has no endpoint"),
    ],
)
def test_mistakes_are_told_in_one_line(
    options: tuple[str, ...], message: str, calls: Calls, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    record = {"web_name": "A", "id": "A--1", "ques": "Go.", "web": "https://a.example/"}
    Path("tasks.jsonl").write_text(json.dumps(record))
    code, said = calls.run("eval", *options, "--out", tmp_path / "new", "--policy", "random")
    assert (code, len(said.strip().splitlines())) == (2, 1), said
    assert message in said
    assert not (tmp_path / "new").exists()


def test_a_stored_run_is_judged_as_a_benchmark_does(run: Path, judge_model: JudgeModel, calls: Calls) -> None:
    judge = ("--judge", "webjudge", "--judge-base-url", judge_model.url, "--judge-model", "o4")
    before = evaluate(run)
    code, said, notes = calls.apart("eval", "--of", run, *judge, "--json")
    assert code == 0, notes
    told: dict[str, Any] = json.loads(said)
    assert told["judge"].startswith("webjudge/1 o4@")
    assert told["manifest"]["judges"] == [told["judge"]]
    assert told["manifest"]["judge_prompts"] == {told["judge"]: WebJudge.prompts}
    assert told["manifest"]["benchmark"] is None
    assert told["rows"]["overall"]["rate"] > (before.rows["overall"].rate or 0)  # it found all good
    assert "attempts judged" in notes
    verdicts = read_verdicts(run)[told["judge"]]
    assert {each.verdict.prompts for each in verdicts.values() if each.verdict} == {WebJudge.prompts}
    asked = len(judge_model.asked)
    code, again, _ = calls.apart("eval", "--of", run, *judge, "--json")
    assert len(judge_model.asked) == asked
    assert json.loads(again) == told
    # And without an endpoint its verdicts are read.
    code, by_name, _ = calls.apart("eval", "--of", run, "--judge", "webjudge", "--json")
    assert json.loads(by_name) == told
    assert evaluate(run) == before


def test_the_two_judges_are_held_against_labels_of_online_mind2web(
    run: Path, judge_model: JudgeModel, calls: Calls, tmp_path: Path
) -> None:
    """The labels name tasks as the benchmark does, without its name before them."""

    def by_two(asked: Any) -> str:
        return "SUCCESS" if "answer" in asked.quotes else webjudge()(asked)

    judge_model.answers = by_two
    for judge in ("webjudge", "webvoyager"):
        endpoint = ("--base-url", judge_model.url, "--model", "o4")
        assert calls.run("judge", run, "--judge", judge, *endpoint)[0] == 0
    native = [task.partition("/")[2] for task in RunReader(run).tasks]
    labels = tmp_path / "human_label.json"
    rows = [{"task_id": task, "Ours_human_label": "1", "Operator_human_label": "0"} for task in native]
    labels.write_text(json.dumps(rows))
    study = ("judge", "agreement", run, "--labels", labels, "--agent", "Ours")
    chosen = ("--judge", "webjudge=WebJudge", "--judge", "webvoyager=WebVoyager")
    said = calls.printed(*study, *chosen, "--json")
    told = json.loads(said[said.index("{") : said.rindex("}") + 1])
    assert {*told["judges"]} == {"WebJudge", "WebVoyager"}
    assert told["judges"]["WebJudge"]["overall"]["confusion"]["both"] > 0
    assert told["differences"][0]["judge"] == "WebVoyager"


class Shop:
    """A website of one page."""

    def __init__(self, port: int) -> None:
        self.host = f"127.0.0.1:{port}"

    def app(self) -> Starlette:
        async def page(request: Request) -> HTMLResponse:
            return HTMLResponse("<title>Lamps</title><h1>The lamp costs $7.</h1>")

        return Starlette(routes=[Route("/{path:path}", page)])


@asynccontextmanager
async def shop_and_models() -> AsyncIterator[tuple[Shop, Endpoint, JudgeModel]]:
    async with serving(Shop, Shop.app) as shop, serve() as policy, serve_judge(webjudge()) as judge:
        policy.text = answers("$7")
        yield shop, policy, judge


@pytest.mark.browser
def test_a_benchmark_in_one_command(tmp_path: Path, calls: Calls) -> None:
    with beside(shop_and_models()) as (shop, policy, judge):
        file = tmp_path / "Online_Mind2Web.json"
        hosts = [shop.host, shop.host.replace("127.0.0.1", "127.0.0.2")]  # where nobody listens
        sites = [f"http://{host}/" for host in hosts]
        records = [
            {"task_id": f"t{n}", "confirmed_task": "What is it?", "website": host, "level": level}
            for n, (host, level) in enumerate(zip(sites, ("easy", "hard"), strict=True))
        ]
        file.write_text(json.dumps(records))
        settings = tmp_path / "settings.yaml"
        egress = {"allow": hosts}
        policy_check = {"policy": {"check": False}, "collector": {"sessions": 1}}
        settings.write_text(json.dumps({"browser": {"egress": egress}} | policy_check))
        code, said, notes = calls.apart(
            *("eval", "--benchmark", "online-mind2web", "--file", file, "--out", tmp_path / "run"),
            *("--config", settings, "--base-url", policy.url(), "--model", "tiny-1", "--json"),
            *("--judge-base-url", judge.url, "--judge-model", "o4", "--no-report"),
        )
    assert code == 0, said + notes
    told = json.loads(said)
    manifest = told["manifest"]
    assert (manifest["benchmark"], manifest["task_file"]) == ("online-mind2web", file.name)
    assert manifest["judges"][0].startswith("webjudge/1 o4@")
    assert manifest["judge_prompts"] == {manifest["judges"][0]: WebJudge.prompts}
    assert manifest["budget"] == [30, 50, 70]
    reader = RunReader(tmp_path / "run")
    assert {task.id: task.level for task in reader.drawn} == {
        "online-mind2web/t0": "easy",
        "online-mind2web/t1": "hard",
    }
    judged = [each.verdict.prompts for each in reader.trajectories() if each.verdict]
    assert set(judged) <= {WebJudge.prompts}
    assert told["rows"]["overall"]["planned"] == 2
    assert (told["rows"]["easy"]["rate"], told["rows"]["overall"]["rate_of_planned"]) == (1.0, 0.5), notes
    assert told["rows"]["hard"]["no_reward"] == {"environment_error": 1}
    assert 1 < len(told["websites"]) <= FEW_WEBSITES
    assert sum(row["planned"] for row in told["websites"].values()) == 2


def test_the_digests_of_prompts_differ() -> None:
    assert len({DIGEST, WebJudge.prompts}) == 2
