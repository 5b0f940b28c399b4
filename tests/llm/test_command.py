"""``webgym llm``."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from tests.tasks.test_batch import answer, lines_of, note, write_lines

from webgym import cli
from webgym.llm.cache import ReplyCache
from webgym.taskset.batch import write_batches


def webgym(*arguments: str | Path) -> int:
    with pytest.raises(SystemExit) as exit_:
        cli.main(["llm", *map(str, arguments)])
    assert isinstance(exit_.value.code, int)
    return exit_.value.code


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache with three noted requests, and results of two of them."""
    monkeypatch.setenv("COLUMNS", "160")
    path = tmp_path / "replies.sqlite"

    async def make() -> None:
        async with ReplyCache(path) as opened:
            await note(opened, range(3))
            [file] = await write_batches(opened, tmp_path)
            requests = lines_of(file.path)
            replies = [
                answer(request, prompt_tokens=1_000_000, completion_tokens=1000) for request in requests
            ]
            write_lines(tmp_path / "good.jsonl", replies[:2])
            replies[2]["response"]["status_code"] = 500
            write_lines(tmp_path / "bad.jsonl", [replies[2]])

    asyncio.run(make())
    return path


def test_import_and_usage(cache: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert webgym("import", cache, tmp_path / "good.jsonl", "--price", "2.5,10") == 0
    assert "2 replies stored, 0 stored before, 0 not answered" in capsys.readouterr().out
    assert webgym("import", cache, tmp_path / "good.jsonl", tmp_path / "bad.jsonl") == 1
    told = capsys.readouterr()
    assert "0 replies stored, 2 stored before, 1 not answered" in told.out
    assert "bad.jsonl:1: not answered (500)" in told.err
    assert webgym("usage", cache) == 0
    head, row, total = capsys.readouterr().out.splitlines()
    assert head.split()[:3] == ["purpose", "model", "calls"]
    assert row.split() == ["rubrics", "tiny", "2", "2", "0", "2,000,000", "0", "2,000", "5.0200"]
    assert total.split() == ["all", "2", "2", "0", "2,000,000", "0", "2,000", "5.0200"]


def test_prices_that_are_not_known_are_not_made_up(
    cache: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert webgym("import", cache, tmp_path / "good.jsonl") == 0
    assert webgym("usage", cache) == 0
    told = capsys.readouterr().out
    assert "unknown" in told
    assert "2 calls had no price" in told


def test_prices_from_a_table(cache: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "prices.yaml"
    table.write_text("tiny: {prompt: 2, completion: 10, batch: 0.5}\n")
    assert webgym("import", cache, tmp_path / "good.jsonl", "--prices", table) == 0
    assert webgym("usage", cache) == 0
    assert "2.0100" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["usage", "nothing.sqlite"], 2, "there is no file"),
        (["usage", "foreign"], 1, "not a database"),
        (["import", "replies.sqlite", "nothing.jsonl"], 2, "cannot be read"),
        (["import", "replies.sqlite", "good.jsonl", "--price", "free"], 2, "is not a price"),
        (["import", "replies.sqlite", "good.jsonl", "--price", "1,2", "--prices", "x"], 2, "one of them"),
    ],
)
def test_what_cannot_be_used_is_one_line(
    cache: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    code: int,
    words: str,
) -> None:
    monkeypatch.chdir(cache.parent)
    Path("foreign").write_text("something else " * 100)
    assert webgym(*arguments) == code
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not Path("nothing.sqlite").exists()
