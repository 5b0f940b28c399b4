"""Promises that the repository as a whole keeps."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from tests.conftest import Calls

import webgym
from webgym import cli

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "src"

# --- every setting is read by something (HOUSE.md, rule 2) --------------------------------------------


def test_every_setting_is_read_somewhere() -> None:
    """As ``something.name``, or by a name in quotation marks; or its section is written out whole."""
    # The families of the offline web are a third of the code and know no settings.
    texts = [path.read_text("utf-8") for path in SOURCE.rglob("*.py") if "families" not in path.parts]
    nodes = [node for text in texts for node in ast.walk(ast.parse(text))]
    classes = [node for node in nodes if isinstance(node, ast.ClassDef)]
    bases = {node: set(re.findall(r"\w+", " ".join(map(ast.unparse, node.bases)))) for node in classes}
    known = {"BaseModel"}
    while grown := {node.name for node, above in bases.items() if above & known} - known:
        known |= grown
    models = [node for node in classes if node.name in known]
    assert {"BrowserConfig", "RunConfig"} <= {node.name for node in models}, "models are not found any more"
    read = {node.attr for node in nodes if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load)}
    read |= {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    assert [
        f"{model.name}.{item.target.id}"
        for model in models
        if "self.model_dump" not in ast.unparse(model)
        for item in model.body
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)
        if item.target.id not in read and "ClassVar" not in ast.unparse(item.annotation)
    ] == []


# --- the command line ------------------------------------------------------------------------------------


def commands(path: list[str], command: Any) -> Iterator[tuple[list[str], Any]]:
    """A command and, if it is a group, everything under it, each with the words that call it."""
    yield path, command
    for name in getattr(command, "commands", {}):
        yield from commands([*path, name], command.get_command(None, name))  # which may import it


@pytest.mark.parametrize(
    "verb", [verb for verb in cli.VERBS if verb.is_installed], ids=lambda verb: verb.name
)
def test_every_verb_and_sub_verb_explains_itself(verb: cli.Verb, calls: Calls) -> None:
    """``--help`` works, and every command and option in it has a text."""
    whole: Any = typer.main.get_command(cli.build(verb.name))
    for path, command in commands([verb.name], whole.commands[verb.name]):
        assert command.help, f"webgym {' '.join(path)} has no help text"
        for parameter in command.params:
            assert parameter.param_type_name == "argument" or parameter.help, (
                f"webgym {' '.join(path)}: {parameter.name} has no help text"
            )
    assert f"webgym {verb.name}" in calls.printed(verb.name, "--help", COLUMNS="120")


# --- the facade --------------------------------------------------------------------------------------------


def test_the_facade_holds_what_it_names() -> None:
    exported = webgym.__all__
    assert len(set(exported)) == len(exported)
    for name in exported:
        assert getattr(webgym, name, None) is not None, f"webgym.{name} is in __all__ and is not there"
    namespace: dict[str, object] = {}
    exec("from webgym import *", namespace)
    assert set(exported) <= namespace.keys()


def test_only_token_ids_need_torch() -> None:
    script = (
        "import sys, webgym\n"
        "sys.modules['torch'] = None\n"
        "def needs_torch(name):\n"
        "    try:\n        getattr(webgym, name)\n"
        "    except ImportError:\n        return True\n"
        "print([name for name in webgym.__all__ if needs_torch(name)])\n"
    )
    answer = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    tokens = ["Renderer", "Sampled", "TokenRequest", "TokenRollout", "TokenRow", "roll_out"]
    assert answer.stdout.strip() == str(tokens)


# --- the tree and the locks --------------------------------------------------------------------------------


def locked(name: str) -> dict[str, str]:
    lines = (ROOT / "requirements" / name).read_text().splitlines()
    pins = (line.removesuffix(" \\").partition(" ;")[0].split("==") for line in lines if "==" in line)
    return {canonicalize_name(package): version for package, version in pins}


@pytest.mark.parametrize(
    ("lock", "groups"), [("dev.txt", ["build", "dev"]), ("docs.txt", ["docs"])], ids=["dev", "docs"]
)
def test_the_lock_holds_what_the_project_asks_for(lock: str, groups: list[str]) -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = [line for group in groups for line in declared["dependency-groups"][group]]
    if lock == "dev.txt":
        wanted += declared["project"]["dependencies"]
    pins = locked("dev.txt") | locked(lock)
    for requirement in map(Requirement, wanted):
        version = pins.get(canonicalize_name(requirement.name))
        assert version is not None, f"{requirement.name} is not locked: run `make lock`"
        assert requirement.specifier.contains(version), f"{requirement} excludes {version}: run `make lock`"


def test_an_extra_allows_the_release_that_was_tested_and_not_the_next() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    page = (ROOT / "docs" / "integrations.md").read_text()
    rows = re.findall(r"^\| \[[^|]+\| (?:[\w-]+ )?([\d.]+) \| `([\w-]+)` \|", page, re.MULTILINE)
    assert {extra for _, extra in rows} >= {"gymnasium", "skyrl", "trl"}
    for tested, extra in rows:
        allowed = Requirement(extras[extra][0]).specifier
        major, minor = tested.split(".")[:2]
        assert allowed.contains(tested), extra
        assert not allowed.contains(f"{major}.{int(minor) + 1}"), extra


def test_the_wheel_holds_the_package_and_of_benchmarks_what_the_commands_use() -> None:
    from hatchling.builders.wheel import WheelBuilder

    held = {file.distribution_path for file in WheelBuilder(str(ROOT)).recurse_included_files()}
    assert "webgym/py.typed" in held
    assert [name for name in held if not name.startswith("webgym/")] == []
    benchmarks = {name for name in held if re.fullmatch(r"webgym/bench/.+\.py", name)}
    assert benchmarks
    used, unread = set[str](), ["webgym/cli/bench.py", "webgym/cli/simulate.py"]
    while unread:
        source = (SOURCE / unread.pop()).read_text()
        for module in re.findall(r"^ *from (webgym\.bench[\w.]*) import", source, re.MULTILINE):
            parts = module.split(".")
            packages = {f"{'/'.join(parts[:end])}/__init__.py" for end in range(2, len(parts) + 1)}
            new = {name for name in {f"{'/'.join(parts)}.py", *packages} if (SOURCE / name).is_file()} - used
            used |= new
            unread += new
    assert benchmarks == used


def test_versions_agree() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"]
    assert (webgym.__version__, cited) == (declared, declared)


def test_no_package_is_locked_twice_and_every_file_but_torchs_has_a_hash() -> None:
    assert not locked("dev.txt").keys() & locked("docs.txt").keys()
    text = (ROOT / "requirements/dev.txt").read_text() + (ROOT / "requirements/docs.txt").read_text()
    assert re.findall(r"^(\S+)==\S+$", text, re.MULTILINE) == ["torch"]
