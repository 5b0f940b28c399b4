"""``webgym tasks sources``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.tasks.sources import native

from webgym import cli
from webgym.tasks.sources import SOURCES


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as left:
        cli.main(["tasks", "sources", *arguments])
    return int(left.value.code or 0)


def test_it_lists_the_sources_with_the_papers_counts(capsys: pytest.CaptureFixture[str]) -> None:
    assert run() == 0
    said = capsys.readouterr().out
    for source in SOURCES.values():
        [line] = [line for line in said.splitlines() if source.name in line.split()]
        assert f"{source.paper_tasks:,}" in line
        assert source.licence in line


def test_it_says_what_was_read_and_what_was_skipped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.jsonl").write_text(native.as_lines(native.DEEPSHOP) + "{\n" * 4)
    (tmp_path / "b.jsonl").write_text(native.as_lines(native.GAIA))
    (tmp_path / "c.jsonl").write_text(native.as_lines(native.INSTA))
    assert (
        run("--read", f"deepshop={tmp_path}", "--read", f"gaia-web={tmp_path}/b.jsonl", "--lines", "3") == 0
    )
    said = capsys.readouterr().out
    for expected in (
        "records    6",
        "tasks      2 (the paper's 150)",
        "skipped    4",
        "websites   1 by registrable domain (the paper's 1)",
        "website    2 given",
        "flags      1 garbled",
        f"{tmp_path / 'a.jsonl'}, line 3: no JSON",
        "and 1 more",
        f"{tmp_path / 'b.jsonl'}: no record of deepshop among 2; the first: a record of gaia-web",
        f"{tmp_path / 'c.jsonl'}: no record of deepshop among 2; the first: a record of insta-v3",
        "website    2 inferred",
        "flags      2 placeholder-website",
    ):
        assert expected in said


@pytest.mark.parametrize(
    ("given", "code", "words"),
    [
        ("deepshop", 2, "is not NAME=WHERE"),
        ("deepshop=", 2, "is not NAME=WHERE"),
        ("nothing=x.jsonl", 2, "unknown source 'nothing'"),
        ("deepshop=no-such-file.jsonl", 2, "No such file"),
    ],
)
def test_what_cannot_be_read_is_one_line(
    capsys: pytest.CaptureFixture[str], given: str, code: int, words: str
) -> None:
    assert run("--read", given) == code
    said = capsys.readouterr().err
    assert words in said
    assert len(said.strip().splitlines()) == 1


def test_it_fails_if_there_is_no_task(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps([{"ques": None}]))
    assert run("--read", f"deepshop={path}") == 2, "as wherever a file holds no task"
    assert "'ques' is empty" in capsys.readouterr().out
