"""What users copy works: the examples run, the presets load."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from webgym.cli._run import settings

ROOT = Path(__file__).parent.parent


@pytest.mark.browser
@pytest.mark.parametrize("example", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_an_example_runs(example: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(example), str(tmp_path / "run")],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "attempts" in done.stdout


@pytest.mark.parametrize("preset", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda path: path.stem)
def test_a_preset_loads(preset: Path) -> None:
    assert settings(preset, {}).policy.name == "openai"
