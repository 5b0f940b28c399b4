"""The bare wheel in an environment of its own: with what it requires, and without any extra."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from collections.abc import Iterator
from importlib.metadata import Distribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]


def required(name: str, known: dict[str, Distribution]) -> None:
    """Add a distribution and all that it requires, without extras."""
    if canonicalize_name(name) in known:
        return
    known[canonicalize_name(name)] = found = distribution(name)
    for line in found.requires or ():
        requirement = Requirement(line)
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            required(requirement.name, known)


def tops(found: Distribution) -> Iterator[Path]:
    """What a distribution puts into the folder of packages."""
    folder = Path(str(found.locate_file("")))
    for top in {file.parts[0] for file in found.files or () if file.parts[0] not in ("..", "__pycache__")}:
        yield folder / top


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of an environment that holds the wheel and what it requires, linked from ours."""
    from hatchling.builders.wheel import WheelBuilder

    folder = tmp_path_factory.mktemp("wheel")
    venv.create(folder / "env", with_pip=False, symlinks=True)
    (packages,) = (folder / "env" / "lib").glob("python*/site-packages")
    wheel = next(iter(WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"])))
    subprocess.run([sys.executable, "-m", "zipfile", "-e", wheel, packages], check=True)
    known: dict[str, Distribution] = {}
    required("webgym-rl", known)
    assert "torch" not in known
    for name, found in known.items():
        for top in tops(found) if name != "webgym-rl" else ():
            if not (packages / top.name).exists():
                (packages / top.name).symlink_to(top)
    return folder / "env" / "bin" / "python"


def webgym(python: Path, *words: str) -> tuple[int, str]:
    """A command's exit code, and what it printed, in an empty folder."""
    surroundings = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [python, "-m", "webgym", *words],
        cwd=python.parent,
        env=surroundings,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


TRAIN = "this needs torch (pip install 'webgym-rl[train]')"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("demo", "training needs torch (pip install 'webgym-rl[train]', or add --collect-only)"),
        ("train qwen3-vl-8b --explain", TRAIN),
        ("pretrain recipe --out x", TRAIN),
        ("study --out x", TRAIN),
        ("simulate", "this needs simpy (pip install 'webgym-rl[simulate]')"),
    ],
)
def test_a_command_that_needs_an_extra_names_it(python: Path, words: str, said: str) -> None:
    assert webgym(python, *words.split()) == (2, f"webgym: {said}\n")


def test_all_commands_but_those_need_no_extra(python: Path) -> None:
    """Modules of commands are imported whole, and the presets are there."""
    code = (
        "import importlib, webgym.cli as cli\n"
        "from webgym.core.settings import presets\n"
        "print(*(importlib.import_module(verb.module).__name__ for verb in cli.VERBS))\n"
        "print('tiny' in presets(), 'study/only-easy' in presets())\n"
    )
    done = subprocess.run([python, "-c", code], cwd=python.parent, capture_output=True, text=True, check=True)
    *_, presets = done.stdout.splitlines()
    assert presets == "True True"
