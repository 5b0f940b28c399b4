"""``webgym judge`` as a person types it."""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from tests.judge.judge_model import Asked, JudgeModel, serve_judge
from tests.serving import beside

from webgym.cli import main
from webgym.store.records import decode
from webgym.store.runs import RunReader
from webgym.store.verdicts import read_verdicts


@pytest.fixture
def judge_model() -> Iterator[JudgeModel]:
    """A model that finds that everything holds, in a thread of its own."""

    def answers(asked: Asked) -> str:
        if asked.stage == "keypoint":
            return asked.each(lambda name: True)
        return asked.verdict(asked.stage != "blocking")

    with beside(serve_judge(answers)) as model:
        yield model


ANY = "operator:eq"
"""A judge, as any function of two arguments is one. It finds that nothing succeeded."""


def webgym(*arguments: str | Path) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    assert isinstance(ended.value.code, int)
    return ended.value.code


def test_a_run_is_judged_and_compared(
    run: Path, judge_model: JudgeModel, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [
        "--base-url",
        judge_model.url,
        "--model",
        "judge-1",
        "--rubric.fact.chat.model",
        "big-1",
        "--price",
        "2,8",
    ]
    assert webgym("judge", run, *arguments, "--compare", "recorded") == 0
    said = capsys.readouterr().out
    asked = len(judge_model.asked)
    assert asked > 20
    assert "judge      rubric/4 big-1@" in said
    assert f"{asked} replies, {asked * 12:,} + {asked * 3:,} tokens, ${asked * 48 / 1e6:.4f}" in said
    assert "keypoint" in said
    assert "note       the scripted policy is an oracle" in said
    assert "compared   rubric/4" in said
    assert "with       recorded" in said
    assert "failure / success" in said or "success / failure" in said
    assert {asked.body["model"] for asked in judge_model.of("fact")} == {"big-1"}
    # Again: nothing is asked, everything is shown.
    assert webgym("judge", "run", run, *arguments) == 0
    said = capsys.readouterr().out
    assert len(judge_model.asked) == asked
    assert "of them earlier" in said
    assert "cost now   no model was called" in said
    # Judged anew, every reply comes from the cache.
    assert webgym("judge", run, *arguments, "--again") == 0
    assert len(judge_model.asked) == asked
    assert "from the cache" in capsys.readouterr().out
    assert len(read_verdicts(run)) == 1


def test_a_function_of_ones_own(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lenient_judges.py").write_text("def always(task, episode): return True, 'why not'\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert webgym("judge", run, "--judge", "lenient_judges:always", "--limit", "3") == 0
    (held,) = read_verdicts(run).values()
    assert len(held) == 3


def test_a_judge_that_now_always_fails_is_no_success_for_its_earlier_verdicts(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "away_judges.py").write_text(
        "import os\ndef away(task, episode):\n    return os.stat('up').st_size == 0, 'why not'\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "up").touch()
    assert webgym("judge", run, "--judge", "away_judges:away", "--limit", "2") == 0
    (tmp_path / "up").unlink()
    assert webgym("judge", run, "--judge", "away_judges:away") == 1


def test_records_that_cannot_be_judged_are_named_and_the_others_are_judged(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reader = RunReader(run)
    changed, odd, lost, *_ = (one for one in reader.trajectories() if one.episode.ending.is_regular)
    shard, tasks = run / "trajectories/00000.jsonl", run / "tasks.jsonl"
    lines = shard.read_bytes().splitlines(keepends=True)
    places = [next(at for at, line in enumerate(lines) if decode(line) == one) for one in (changed, odd)]
    lines[places[0]] = lines[places[0]].replace(b"Memory", b"memory", 1)
    body = msgspec.json.encode(odd).replace(b'"steps":[', b'"steps":[7,', 1)  # its checksum is right
    digest = hashlib.sha256(body).hexdigest().encode()
    lines[places[1]] = b'{"sha256":"' + digest + b'","trajectory":' + body + b"}\n"
    shard.write_bytes(b"".join(lines))
    tasks.write_bytes(tasks.read_bytes().replace(lost.episode.task_id.encode(), b"another", 1))
    assert webgym("judge", run, "--judge", ANY) == 0
    said = capsys.readouterr().out
    assert "left out   3 records that cannot be judged" in said
    for place in places:
        assert f"trajectories/00000.jsonl line {place + 1}: " in said
    assert f"the run does not hold its task {lost.episode.task_id}" in said
    (held,) = read_verdicts(run).values()
    assert f"judged     {len(held)} of {len(held)} attempts" in said


def test_a_judge_that_always_fails_is_told_with_its_reason(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "failing_judges.py").write_text(
        "def never(task, episode): raise ValueError('no\\x1b[31m idea')\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert webgym("judge", run, "--judge", "failing_judges:never", "--limit", "3") == 1
    said = capsys.readouterr().out
    assert "judged     0 of" in said
    assert "  3 failing_judges:never failed: ValueError: no\N{REPLACEMENT CHARACTER}[31m idea" in said
    assert "\x1b" not in said


def test_what_was_paid_for_attempts_without_a_verdict_is_told(
    run: Path, judge_model: JudgeModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    judge_model.answers = lambda asked: "It looks fine to me."
    chat = {"base_url": judge_model.url, "model": "mumbler"}
    # Else the reference answers of this run's tasks decide, whatever the model says.
    settings = {"name": "rubric", "rubric": {"chat": chat, "reference_rule": "required"}}
    (tmp_path / "judge.yaml").write_text(json.dumps(settings))
    arguments: list[str | Path] = ["--config", tmp_path / "judge.yaml", "--price", "2,8", "--limit", "2"]
    assert webgym("judge", run, *arguments) == 1
    said, asked = capsys.readouterr().out, len(judge_model.asked)
    assert asked > 0
    paid = re.search(
        r"^paid now   ([0-9,]+) replies, ([0-9,]+) \+ ([0-9,]+) tokens, \$0\.[0-9]+$", said, re.MULTILINE
    )
    assert paid is not None, said
    count, read, written = (int(number.replace(",", "")) for number in paid.groups())
    assert 0 < count <= asked  # those that a failure beside them called off were not waited for
    assert (read, written) == (count * 12, count * 3)
    assert "no clear verdict in 9 replies" in said  # three times three: it was judged again twice


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--judge", "rubric"], "needs an endpoint and a model"),
        (["--base-url", "http://127.0.0.1:1/v1"], "needs an endpoint and a model"),
        (["--base-url", "nonsense", "--model", "m"], "base URL"),
        (["--judge", "nobody"], "no judge 'nobody'"),
        (["--judge", "nowhere.at.all:f"], "cannot load"),
        (["--config", "missing.yaml"], "cannot read missing.yaml"),
        (["--judge", ANY, "--compare", "x"], "no judge of this run is called 'x'"),
        (["--judge", ANY, "--price", "x"], "not a price"),
        (["--judge", "offline"], "the offline judge cannot judge 12 of 12 tasks"),  # they have no truth
    ],
)
def test_mistakes_are_told_in_one_line(
    run: Path, arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert webgym("judge", run, *arguments) in (1, 2)
    told = capsys.readouterr().err.strip().splitlines()
    assert len(told) == 1
    assert said in told[0]


def test_a_folder_that_is_no_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert webgym("judge", tmp_path) == 2
    assert "is not a run" in capsys.readouterr().err


def test_a_folder_that_takes_no_verdicts_is_one_line(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run / "verdicts").touch()
    assert webgym("judge", run, "--judge", ANY) != 0
    told = capsys.readouterr().err
    assert "verdicts" in told
    assert "unexpected" not in told


def test_settings_from_a_file(run: Path, judge_model: JudgeModel, tmp_path: Path) -> None:
    file = tmp_path / "judge.yaml"
    file.write_text(
        f"name: rubric\nrubric:\n  chat: {{base_url: '{judge_model.url}', model: judge-1}}\n"
        "  early_exit: true\n  blocking_model: false\npanel: {samples: 3}\n"
    )
    assert webgym("judge", run, "--config", file, "--limit", "1") == 0
    ((name, held),) = read_verdicts(run).items()
    assert name.startswith("panel of 3 at 0.7: rubric/4 judge-1@")
    assert len(held) == 1


def test_who_waits_for_the_judges_model_is_told_why(
    run: Path,
    judge_model: JudgeModel,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("webgym.llm.health._POLL_SECONDS", 0.01)
    judge_model._endpoint.fails_left = 1
    url = judge_model.url.replace("/judge/", "/flaky/")
    chat = f"{{base_url: '{url}', model: judge-1, retry: {{first_seconds: 2}}}}"
    file = tmp_path / "judge.yaml"
    file.write_text(f"name: rubric\nrubric: {{chat: {chat}}}\n")
    webgym("judge", run, "--config", file, "--limit", "1")
    assert "requests are sent again: the endpoint" in capsys.readouterr().out


def test_ctrl_c_says_what_is_kept_and_how_to_go_on(
    run: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def interrupted(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        await asyncio.sleep(10)

    monkeypatch.setattr("webgym.cli.judge._judge", interrupted)
    assert webgym("judge", run, "--judge", ANY) == 130
    kept = "interrupted: the verdicts so far are stored; run the same command again to continue\n"
    assert capsys.readouterr().err == kept


def test_help_is_enough(capsys: pytest.CaptureFixture[str]) -> None:
    assert webgym("judge", "--help") == 0
    assert "webgym judge RUN" in capsys.readouterr().out
    assert webgym("judge", "run", "--help") == 0
    said = capsys.readouterr().out
    for option in ("--judge", "--base-url", "--set", "--compare", "--again"):
        assert option in said
