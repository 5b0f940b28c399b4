"""Limits on the size of the project: above one is an error, and limits only fall."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parent.parent


def load_script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


ratchets = load_script("ratchets")


@pytest.mark.parametrize(
    ("figure", "is_wrong", "new_limit"),
    [(11, True, 10), (10, False, 10), (9, False, 9)],
    ids=["above", "at", "below"],
)
def test_a_limit_holds_and_only_falls(tmp_path: Path, figure: int, is_wrong: bool, new_limit: int) -> None:
    (tmp_path / "ratchets.toml").write_text("# why\nsettings = 10\n")
    figures = {"settings": figure}
    lines = ratchets.above(figures, ratchets.read_limits(tmp_path))
    assert lines == (["settings is 11, its limit 10: " + ratchets.ADVICE["settings"]] if is_wrong else [])
    ratchets.lower(tmp_path, figures)
    assert (tmp_path / "ratchets.toml").read_text() == f"# why\nsettings = {new_limit}\n"
