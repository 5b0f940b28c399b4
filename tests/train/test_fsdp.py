"""FSDP2 gives the update of one process and goes on with any number: here on processors, over gloo."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.inference.tiny import write_tiny_model
from tests.train.forking import together
from tests.train.test_update import assert_same
from tests.train.updating import SHARDED, go_on, run_case, update_sharded

from webgym.core.errors import ConfigError
from webgym.train.sharding import is_fsdp


@pytest.mark.timeout(600)  # eight processes, beside others
def test_two_and_four_processes_give_the_updates_of_one_and_go_on_from_each_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.train.update.REPLY_TOKENS", 2)
    models, two, four, two_again = (tmp_path / name for name in ("models", "two", "four", "two_again"))
    for model in SHARDED:
        write_tiny_model(models / model, tied=model == "tied")
    together(update_sharded, 2, models, two, 3, None)
    together(update_sharded, 4, models, four, 1, two)
    together(update_sharded, 2, models, two_again, 0, four)
    for model, cases in SHARDED.items():
        start = models / model
        for name, settings in cases.items():
            run_case(name, start, tmp_path / name, **settings)
            is_exact = "precision" not in settings
            for some in (two, four) if name == next(iter(cases)) else (two,):
                updated = some / model / name
                assert_same(start, tmp_path / name, updated, tolerance=1e-3 if is_exact else 0.3)
        straight, alone = tmp_path / model / "straight", tmp_path / model / "alone"
        go_on(start, straight, None)
        go_on(start, alone, two / model / "half")
        for again in (alone, four / model / "again", two_again / model / "again"):
            assert_same(start, straight, again)


def test_fsdp_is_for_several_processes_and_does_not_offload(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not is_fsdp(2)
    monkeypatch.setenv("ACCELERATE_USE_FSDP", "true")
    assert not is_fsdp(1)
    assert is_fsdp(2)
    monkeypatch.setenv("FSDP_OFFLOAD_PARAMS", "true")
    with pytest.raises(ConfigError, match="offloading is not supported"):
        is_fsdp(2)
