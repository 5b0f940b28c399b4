"""LLaMA-Factory's own loader reads what ``webgym export --format sharegpt`` writes.

It wants other versions of our packages, so it has a Python of its own, which ``WEBGYM_LLAMAFACTORY_PYTHON``
names.
"""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
from pathlib import Path

import pytest
from tests.integrations.engine import example
from tests.rollout.running import small_run

from webgym.agent.config import AgentConfig
from webgym.results.export import export
from webgym.run.collect import collect

PYTHON = os.environ.get("WEBGYM_LLAMAFACTORY_PYTHON", "")


@pytest.mark.skipif(not PYTHON, reason="WEBGYM_LLAMAFACTORY_PYTHON names no Python with llamafactory 0.9.5")
def test_its_loader_reads_every_step(tmp_path: Path) -> None:
    config = small_run(3, agent=AgentConfig(profile="qwen3-vl"))
    asyncio.run(collect(config, tmp_path / "run"))
    out = tmp_path / "out"
    export(tmp_path / "run", out, "sharegpt")
    written = json.loads((out / "sharegpt.json").read_text())
    script = Path(__file__).with_name("llamafactory_loads.py")
    printed = subprocess.run([PYTHON, script, out], check=True, capture_output=True, text=True).stdout
    rows = json.loads(printed.splitlines()[-1])
    assert len(rows) == len(written) > 3
    for row, sample in zip(rows, written, strict=True):
        system, *between, reply = sample["messages"]
        assert row["_system"] == system["content"]
        assert row["_prompt"] == between
        assert row["_response"] == [reply]
        assert all(before == after for before, after in row["sizes"])
        assert row["_images"] == [str(out / name) for name in sample["images"]]
        assert sum(each["content"].count("<image>") for each in between) == len(sample["images"])


def test_the_example(tmp_path: Path) -> None:
    config = small_run(2)
    example("llamafactory_data").main(tmp_path, config)
    names = json.loads((tmp_path / "data" / "dataset_info.json").read_text())
    samples = json.loads((tmp_path / "data" / names["webgym"]["file_name"]).read_text())
    assert samples
    assert all((tmp_path / "data" / name).is_file() for sample in samples for name in sample["images"])
