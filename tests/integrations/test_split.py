"""An adapter that a trainer may use takes training tasks unless told otherwise."""

from __future__ import annotations

import re
from pathlib import Path

import webgym.integrations

FOR_EVALUATION = {"inspect_ai.py"}


def test_no_default_lets_a_trainer_see_test_tasks() -> None:
    [folder] = webgym.integrations.__path__
    defaults = {
        file.name: set(re.findall(r'\bsplit: [^=\n]+ = (?:[^\n]*, )?"(\w+)"\)?,?\n', file.read_text()))
        for file in Path(folder).glob("*.py")
    }
    assert {name for name, splits in defaults.items() if splits} >= {"verifiers.py", "shared.py", "verl.py"}
    assert {name for name, splits in defaults.items() if splits - {"train"}} == FOR_EVALUATION
