"""``webgym train --check``: what it says of a training that can start or go on, and of one that cannot."""

from __future__ import annotations

import asyncio
import copy
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import SecretStr
from tests.conftest import Calls
from tests.documented import documented
from tests.train.test_kill import GIVEN

from webgym.core.errors import NavigationFailed
from webgym.rollout.driver import BrowserSession, EpisodeDriver
from webgym.run.config import Secrets
from webgym.server.messages import View
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig
from webgym.train.rehearsal import rehearse
from webgym.train.start import open_training

pytestmark = pytest.mark.timeout(400)  # real browsers, models and processes, beside others


@pytest.fixture
def given(tmp_path: Path) -> dict[str, Any]:
    """Settings of a training of one iteration, without browsers."""
    settings = copy.deepcopy(GIVEN)
    settings["learn"]["model"] = "tiny"
    settings["rollout"]["server"]["pictures"] = str(tmp_path / "pictures")
    settings["loop"] |= {"iterations": 1, "tasks": 24, "evaluate_every": 0}
    return settings


def test_a_training_is_checked_before_its_first_start_and_before_it_goes_on(
    tmp_path: Path, given: dict[str, Any], calls: Calls, monkeypatch: pytest.MonkeyPatch
) -> None:
    start, tried = EpisodeDriver.start, list[str]()

    async def start_second(self: EpisodeDriver, session: BrowserSession) -> View:
        tried.append(self.planned.task.id)
        if len(tried) == 1:
            raise NavigationFailed("the website is down")
        return await start(self, session)

    monkeypatch.setattr(EpisodeDriver, "start", start_second)
    file, out = tmp_path / "train.yaml", tmp_path / "out"
    file.write_text(yaml.safe_dump(given))

    names = {"CONFIG": file, "training/first": out}
    words = documented("webgym train CONFIG --out training/first --check")
    code, printed = calls.run(*(names.get(word, word) for word in words))

    assert code == 0, printed
    (page,) = re.findall(r"^page       (\S+), 192 x 128, opened$", printed, re.MULTILINE)
    for line in (
        r"tasks      465 to train on, 155 to test on",
        rf"folder     {out} can be written, \d+ GiB are free",
        r"judge      offline/\d+",
        r"policy     \w+ replies in [\d.]+ s: \w+",
        r"update     4 steps of \d+ tokens \(stored token ids\) on 1 processes in [\d.]+ s, loss [\d.]+",
        r"the check passed: without --check, the training starts",
    ):
        assert re.search(rf"^{line}$", printed, re.MULTILINE), line
    assert len(set(tried)) == 2
    assert tried[1].split("/")[1] in page
    assert not out.exists()

    async def train() -> None:
        async with open_training(TrainConfig.model_validate(given), out) as training:
            await training.run()

    asyncio.run(train())
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    assert TrainingFolder(out).latest_weights() is not None

    code, printed = calls.run("train", "--resume", out, "--check")

    assert code == 0, printed
    assert "weights    of iteration 1 are served, and pass the self-test\n" in printed
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("learn", "rollout", "message"),
    [
        ({"update": {"cutoff_tokens": 10}}, {}, r"the policy's replies cannot be trained on: too_long \("),
        (
            {},
            {"server": {"static": False, "url": "http://127.0.0.1:9", "sites_url": "http://127.0.0.1:9"}},
            r"127\.0\.0\.1:9",
        ),
    ],
)
def test_a_training_that_could_not_go_on_is_told_in_one_line(
    tmp_path: Path, given: dict[str, Any], learn: Any, rollout: Any, message: str
) -> None:
    given["learn"] |= learn
    given["rollout"] |= rollout
    settings = TrainConfig.model_validate(given)
    told: list[str] = []
    secrets = Secrets(SecretStr("s" * 32), SecretStr("t" * 32))
    with pytest.raises(Exception, match=message):
        asyncio.run(rehearse(settings, tmp_path / "out", resume=False, secrets=secrets, tell=told.append))
    assert any(line.startswith("judge") for line in told)
    assert not (tmp_path / "out").exists()
