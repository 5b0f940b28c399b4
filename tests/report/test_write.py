"""Writing ``report.html``."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import json
import os
import re
import subprocess
import sys
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from webgym.cli import main
from webgym.core.errors import RunFolderError
from webgym.core.outcome import Outcome
from webgym.core.trajectory import ImageRef, Message, Trajectory
from webgym.report.config import ReportConfig
from webgym.report.template import CHUNK
from webgym.report.write import write_report
from webgym.store.runs import RunReader, RunWriter

SMALL = ReportConfig(embed=True, image_width=160)


def _data(text: str, element_id: str) -> object:
    found = re.search(rf'<script type="application/json" id="{element_id}">(.*?)</script>', text, re.S)
    assert found is not None
    return json.loads(found[1])


def _packed(text: str, number: int) -> list[dict[str, Any]]:
    found = re.search(rf'<script type="text/plain" id="c-{number}">(.*?)</script>', text)
    assert found is not None
    shown: list[dict[str, Any]] = json.loads(zlib.decompress(base64.b64decode(found[1])))
    return shown


def test_it_holds_every_trajectory_and_every_picture(run: Path) -> None:
    told: list[tuple[str, int, int]] = []
    path = write_report(run, config=SMALL, progress=lambda *step: told.append(step))
    assert path == run / "report.html"
    text = path.read_text()
    rows = _data(text, "rows")
    assert isinstance(rows, list)
    assert Counter(row["outcome"] for row in rows) == Counter(
        {**dict.fromkeys(map(str, Outcome), 1), "success": 4, "failure": 2}
    )
    pages = _packed(text, 0)
    assert len(pages) == len(rows)
    for row, page in zip(rows, pages, strict=True):
        assert page["id"] == row["id"]
        for step in page["steps"]:
            assert f'id="p-{step["shot"]}"' in text
    pictures = len(list((run / "screenshots").glob("*/*.png")))
    assert told[-1] == ("pictures", pictures, pictures)
    assert ("trajectories", 12, 12) in told
    assert not list(run.glob(".report*"))


def test_nothing_is_loaded_from_outside(run: Path) -> None:
    text = write_report(run, config=SMALL).read_text()
    shell = re.sub(r'<script type="(application/json|text/plain)".*?</script>', "", text, flags=re.S)
    assert not re.findall(r"(?:src|href)=[\"']?(?:https?:)?//", shell)
    assert not re.findall(r"@import|url\(\s*[\"']?http", shell)


def test_the_report_says_that_an_oracle_played_and_how_many_replies_were_invalid(run: Path) -> None:
    text = write_report(run, config=SMALL).read_text()
    assert "the scripted policy is an oracle: it plays known solutions and uses no model." in text
    assert "replies without an action: " in text


def test_a_report_is_replaced_whole(run: Path) -> None:
    (run / "report.html").write_text("old")
    assert write_report(run, config=SMALL).read_text().startswith("<!doctype html>")


@pytest.mark.parametrize("config", [ReportConfig(), ReportConfig(embed=True, image_budget_bytes=0)])
def test_pictures_are_embedded_on_demand_and_within_the_budget(run: Path, config: ReportConfig) -> None:
    assert 'id="p-' not in write_report(run, config=config).read_text()


async def test_the_report_of_thousands_stays_light(run: Path) -> None:
    """Twelve trajectories stand for as many as there are: what each adds is told by the file's growth."""
    small = (await asyncio.to_thread(write_report, run)).stat().st_size
    held = list(RunReader(run).trajectories())
    async with await RunWriter.reopen(run) as writer:
        for number in range(1, 26):
            for one in held:
                sample, name = 100 * number + one.episode.sample, f"{one.episode.attempt_id}-{number}"
                episode = replace(one.episode, attempt_id=name, sample=sample)
                await writer.append(replace(one, episode=episode))
    path = await asyncio.to_thread(write_report, run)
    assert len(_packed(path.read_text(), 12)) == 312 - 12 * CHUNK
    each = (path.stat().st_size - small) / (25 * len(held))
    assert each < 2_500, "bytes of a trajectory: ten thousand make 25 MB"


def test_the_report_of_a_large_run_holds_the_pages_of_a_part(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.report.write.MOST_PAGES", 5)
    text = write_report(run).read_text()
    rows = _data(text, "rows")
    assert isinstance(rows, list)
    assert len(rows) == 12
    with_page = [row for row in rows if "page" in row]
    assert [row["page"] for row in with_page] == list(range(4))  # every third
    assert [page["id"] for page in _packed(text, 0)] == [row["id"] for row in with_page]


def test_corrupt_records_are_counted_on_the_page(run: Path) -> None:
    shard = run / "trajectories/00000.jsonl"
    shard.write_bytes(shard.read_bytes().replace(b"Memory", b"memory", 1))
    text = write_report(run, config=SMALL).read_text()
    assert "1 corrupt record is left out: trajectories/00000.jsonl line 1" in text
    rows = _data(text, "rows")
    assert isinstance(rows, list)
    assert len(rows) == 11
    assert "not finished" in text  # the summary tells of twelve


@pytest.mark.parametrize(
    "forged",
    [
        {"screenshot": "../../secret"},
        {"screenshot": "\0"},
        {"screenshot": "f" * 63},
        {"viewport": (0, 768)},
        {"viewport": (10**400, 768)},
        {"messages": (Message("user", (ImageRef("f" * 64, 10**5, 10**5),)),)},
        {"messages": (Message("user", (ImageRef("f" * 64, 60_000, 60_000),)),)},
    ],
)
def test_a_forged_record_is_named_and_left_out(run: Path, forged: dict[str, object]) -> None:
    write_report(run, config=SMALL)  # there are folders now that a name could lead out of
    (run.parent / "secret.webp").write_bytes(b"hidden elsewhere")
    good = next(RunReader(run).trajectories())
    step = good.episode.steps[0]
    is_request = "messages" in forged
    step = replace(step, **forged if is_request else {"observation": replace(step.observation, **forged)})
    with (run / "trajectories/00000.jsonl").open("ab") as shard:
        episode = replace(good.episode, attempt_id="forged#0.0", steps=(step,))
        shard.write(sealed(replace(good, episode=episode)))
        deep = b"[" * 100_000 + b"]" * 100_000
        body = msgspec.json.encode(replace(good, episode=replace(episode, attempt_id="deep#0.0")))
        shard.write(line_of(body.replace(b'"steps"', b'"final_state":{"a":' + deep + b'},"steps"', 1)))
    with (run / "tasks.jsonl").open("ab") as tasks:
        tasks.write(b"no task\n")
    text = write_report(run, config=SMALL).read_text()
    assert "3 corrupt records are left out: tasks.jsonl line 13: " in text
    assert "trajectories/00000.jsonl line 13: " in text
    assert "trajectories/00000.jsonl line 14: " in text
    assert base64.b64encode(b"hidden elsewhere").decode() not in text
    rows = _data(text, "rows")
    assert isinstance(rows, list)
    assert len(rows) == 12


def sealed(trajectory: Trajectory) -> bytes:
    """A record whose checksum is right, whatever it says."""
    return line_of(msgspec.json.encode(trajectory))


def line_of(body: bytes) -> bytes:
    digest = hashlib.sha256(body).hexdigest().encode()
    return b'{"sha256":"' + digest + b'","trajectory":' + body + b"}\n"


async def test_a_run_without_a_trajectory_has_a_report(tmp_path: Path) -> None:
    async with await RunWriter.create(tmp_path / "run", {}, []):
        text = (await asyncio.to_thread(write_report, tmp_path / "run")).read_text()
    assert "nothing rewarded yet" in text
    assert _data(text, "rows") == []


def test_a_folder_that_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError):
        write_report(tmp_path)


def test_the_command_prints_the_path(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["report", str(run), "--embed", "--width", "160"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"{run / 'report.html'}\n"


def test_the_command_says_in_one_line_that_a_folder_is_no_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for verb in ("report", "view"):
        with pytest.raises(SystemExit) as ended:
            main([verb, str(tmp_path)])
        assert ended.value.code == 2
        assert re.fullmatch(r"webgym: .*is not a run.*\n", capsys.readouterr().err)


def test_a_full_disk_is_said_and_leaves_the_old_report(run: Path) -> None:
    (run / "report.html").write_text("old")
    script = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, -1));"
        "from webgym.cli import main; main(['report', sys.argv[1], '--width', '160'])"
    )
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", script, str(run)], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 1
    assert "no space left while writing the report" in done.stderr
    assert (run / "report.html").read_text() == "old"
    assert not list(run.glob(".report*"))
