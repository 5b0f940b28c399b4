"""Promises that the repository as a whole keeps."""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
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

_VALIDATORS = {"field_validator", "model_validator"}


def load_script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# --- every setting is read by something (HOUSE.md, rule 2) --------------------------------------------


@dataclass(frozen=True)
class Model:
    """A pydantic model as it stands in the source: read, not imported, so that one broken module does not
    hide the others."""

    name: str
    bases: frozenset[str]
    fields: tuple[str, ...]
    where: str
    node: ast.ClassDef

    @property
    def dumps_itself(self) -> bool:
        return any(
            isinstance(inner, ast.Attribute) and inner.attr == "model_dump" and name_of(inner.value) == "self"
            for inner in ast.walk(self.node)
        )


Nodes = list[ast.AST]
"""All of a tree, listed once: to walk through it takes longer than to parse it."""


def nodes_of(code: str) -> Nodes:
    return list(ast.walk(ast.parse(code)))


def name_of(node: ast.expr) -> str:
    """The last part of a possibly dotted or called name."""
    if isinstance(node, ast.Call):
        return name_of(node.func)
    if isinstance(node, ast.Subscript):
        return name_of(node.value)
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def classes(nodes: Nodes, where: str) -> Iterator[Model]:
    for node in nodes:
        if isinstance(node, ast.ClassDef):
            fields = tuple(
                item.target.id
                for item in node.body
                if isinstance(item, ast.AnnAssign)
                and isinstance(item.target, ast.Name)
                and name_of(item.annotation) != "ClassVar"
            )
            bases = frozenset(map(name_of, node.bases))
            yield Model(node.name, bases, fields, f"{where}:{node.lineno}", node)


def settings_models(trees: dict[Path, Nodes]) -> list[Model]:
    """The models whose bases lead to pydantic's."""
    found = [model for path, tree in trees.items() for model in classes(tree, path.name)]
    known = {"BaseModel", "BaseSettings"}
    while grown := {model.name for model in found if model.bases & known} - known:
        known |= grown
    return [model for model in found if model.bases & known]


def attributes_read(nodes: Nodes) -> Iterator[str]:
    """Names read as ``something.name``, but for those in a model's own validators, which prove no use."""
    in_validators = {
        inner
        for node in nodes
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
        and any(name_of(decorator) in _VALIDATORS for decorator in node.decorator_list)
        for inner in ast.walk(node)
    }
    for node in nodes:
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load) and node not in in_validators:
            yield node.attr


def names_looked_up(trees: dict[Path, Nodes]) -> set[str]:
    """Names in tuples of strings, in the rooms that read attributes by a name that is a variable."""
    rooms: dict[Path, list[ast.AST]] = {}
    for path, tree in trees.items():
        rooms.setdefault(path.parent, []).extend(tree)
    return {
        element.value
        for nodes in rooms.values()
        if any(
            isinstance(node, ast.Call)
            and name_of(node.func) == "getattr"
            and isinstance(node.args[1], ast.Name)
            for node in nodes
        )
        for node in nodes
        if isinstance(node, ast.Tuple)
        for element in node.elts
        if isinstance(element, ast.Constant) and isinstance(element.value, str)
    }


def unread_settings(trees: dict[Path, Nodes], models: list[Model]) -> list[str]:
    """Fields that nothing reads: not by name, not by a name in a variable, not by dumping the whole model."""
    read = {name for tree in trees.values() for name in attributes_read(tree)} | names_looked_up(trees)
    return [
        f"{model.where} {model.name}.{field}"
        for model in models
        if not model.dumps_itself
        for field in model.fields
        if field not in read
    ]


def parsed_source() -> dict[Path, Nodes]:
    """All but the families of the offline web, which are a third of the code and know no settings."""
    return {
        path: nodes_of(path.read_text("utf-8"))
        for path in SOURCE.rglob("*.py")
        if "families" not in path.parts
    }


def test_every_setting_is_read_somewhere() -> None:
    trees = parsed_source()
    models = settings_models(trees)
    names = {model.name for model in models}
    assert {"FindLimits", "DoctorLimits"} <= names, "the models are not found any more"
    assert unread_settings(trees, models) == []


def test_a_setting_that_nothing_reads_is_found() -> None:
    code = """
class Base(BaseModel):
    used: int
    forgotten: float = Field(default=1.0)
    constant: ClassVar[int] = 3
    @field_validator("only_checked")
    def check(cls, value): return cls.only_checked
class Child(Base):
    only_checked: int
class Other:
    nobody: int
class Pools(BaseModel):
    navigate: int
    execute: int
QUEUES = ("navigate",)
def use(settings, name): return settings.used, getattr(settings, name)
class Body(BaseModel):
    sent: int
    def body(self): return self.model_dump()
"""
    trees = {Path("made_up.py"): nodes_of(code)}
    unread = unread_settings(trees, settings_models(trees))
    assert [line.split()[1] for line in unread] == ["Base.forgotten", "Child.only_checked", "Pools.execute"]


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
    code, said = calls.run(verb.name, "--help", COLUMNS="120")
    assert code == 0, said
    assert f"webgym {verb.name}" in said


def test_verbs_are_listed_once() -> None:
    names = [verb.name for verb in cli.VERBS]
    assert len(set(names)) == len(names)
    modules = {path.stem for path in (SOURCE / "webgym" / "cli").glob("[!_]*.py")}
    assert modules <= {verb.name for verb in cli.VERBS}, "a verb's module is not in the table"


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


def test_no_tracked_file_is_about_a_machine() -> None:
    assert list(load_script("check_tree").findings(ROOT)) == []


@pytest.mark.parametrize(
    ("name", "content", "finding"),
    [
        ("a.py", "PATH = /{}/ada/webgym".format("Users"), "a home directory"),
        ("a.md", "see /{}/.config".format("root"), "a home directory"),
        ("b.txt", "--{}-url https://example.com".format("index"), "a package index setting"),
        ("c.md", "from {}hosted.org/x.whl".format("python"), "a package index"),
        ("requirements/dev.txt", "httpx @ https://example.com/httpx.whl", "name==version"),
        ("requirements/dev.txt", "httpx>=0.28", "name==version"),
    ],
)
def test_what_is_about_a_machine_is_found(tmp_path: Path, name: str, content: str, finding: str) -> None:
    subprocess.run(["git", "init", "--quiet", tmp_path], check=True)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text(content + "\n")
    [line] = load_script("check_tree").findings(tmp_path)
    assert line.startswith(f"{name}:1: ")
    assert finding in line


def test_this_checkouts_own_folder_is_found(tmp_path: Path) -> None:
    subprocess.run(["git", "init", "--quiet", tmp_path], check=True)
    (tmp_path / "notes.md").write_text(f"fine\nrun it in {tmp_path}/x\n")
    [line] = load_script("check_tree").findings(tmp_path)
    assert line.startswith("notes.md:2: holds a folder of this machine")


def locked(name: str) -> dict[str, str]:
    lines = (ROOT / "requirements" / name).read_text().splitlines()
    pins = (line.partition(" ;")[0].split("==") for line in lines if line and not line.startswith("#"))
    return {canonicalize_name(package): version for package, version in pins}


@pytest.mark.parametrize(
    ("lock", "groups"), [("dev.txt", ["build", "dev"]), ("docs.txt", ["docs"])], ids=["dev", "docs"]
)
def test_the_lock_holds_what_the_project_asks_for(lock: str, groups: list[str]) -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = [line for group in groups for line in declared["dependency-groups"][group]]
    if lock == "dev.txt":
        wanted += declared["project"]["dependencies"]
    pins = locked(lock)
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
    assert len(benchmarks) > 20
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


def test_the_locks_agree() -> None:
    ours, docs = locked("dev.txt"), locked("docs.txt")
    assert {name: docs[name] for name in ours.keys() & docs.keys()} == {
        name: ours[name] for name in ours.keys() & docs.keys()
    }


def test_scripts_can_be_run() -> None:
    scripts = [path for path in (ROOT / "scripts").iterdir() if path.is_file() and not path.suffix]
    assert scripts
    for script in [*scripts, ROOT / ".ci" / "run"]:
        assert os.access(script, os.X_OK), f"{script.name} is not executable"


def test_make_help_names_every_target() -> None:
    makefile = (ROOT / "Makefile").read_text()
    [phony] = [line for line in makefile.splitlines() if line.startswith(".PHONY:")]
    told = subprocess.run(["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for target in phony.split()[1:]:
        assert f"make {target} " in told


# --- the documents ------------------------------------------------------------------------------------


def test_tests_that_a_document_names_are_there() -> None:
    tests = "".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    for document in (ROOT / "docs").glob("*.md"):
        for name in re.findall(r"`(test_\w+)`", document.read_text()):
            assert f"def {name}(" in tests, f"{document.name} names {name}"


# --- citations of the paper ---------------------------------------------------------------------------

CITED = re.compile(
    r"§\s?(?P<section>\d+(?:\.\d+)*)|\b(?P<kind>appendix|algorithm|table)\s(?P<one>[A-Z]|\d+)\b"
    r"(?:\sand\s(?P<other>[A-Z])\b)?|\bpaper(?:'s)?,?\s(?P<wrong>section|sec\.?|app\.)\s",
    re.IGNORECASE,
)
TASKS = frozenset({"§3", "appendix E", "Algorithm 1", "Table 1"})
JUDGING = frozenset({"§3.4", "appendix E"})
ROLLOUT = frozenset({"§4", "appendix B"})
AGENT = frozenset({"§5", "appendix C", "appendix E"})
TRAINING = frozenset({"§5", "appendix D", "appendix F"})
SECTIONS = {
    "tasks": TASKS,
    "judge": JUDGING,
    "server": ROLLOUT | {"appendix F"},  # the sizes of its pools
    "browser": ROLLOUT | {"appendix C"},  # the actions
    "rollout": ROLLOUT | JUDGING | TRAINING,  # what an attempt may cost, how it is judged
    "agent": AGENT | TRAINING,  # how replies are sampled
    "train": TRAINING,
    "offline": {"Algorithm 1"},
}
"""Where the paper says what a package is about. Other packages may cite any of these."""


def citations(text: str) -> Iterator[str]:
    """The parts of the paper that a text cites; a form that is not ours as it stands."""
    for found in CITED.finditer(text):
        if found["wrong"]:
            yield found.group().strip()
        elif found["section"]:
            yield f"§{found['section']}"
        else:
            yield from (f"{found['kind']} {one}" for one in (found["one"], found["other"]) if one)


def wrong_citations(name: str, text: str) -> list[str]:
    everything = frozenset().union(*SECTIONS.values())
    parts = Path(name).parts
    package = parts[2] if parts[:2] == ("src", "webgym") else ""
    return [cited for cited in citations(text) if cited not in SECTIONS.get(package, everything)]


def test_citations_of_the_paper_name_sections_that_are_about_it() -> None:
    folders = [SOURCE / "webgym", ROOT / "configs", ROOT / "docs"]
    files = [
        path for folder in folders for path in folder.rglob("*") if path.suffix in (".py", ".md", ".yaml")
    ]
    wrong, count = {}, 0
    for path in [*files, ROOT / "README.md"]:
        name, text = str(path.relative_to(ROOT)), path.read_text("utf-8")
        count += len(list(citations(text)))
        if found := wrong_citations(name, text):
            wrong[name] = found
    assert wrong == {}
    assert count > 50


@pytest.mark.parametrize(
    ("name", "text", "wrong"),
    [
        ("src/webgym/tasks/split.py", "(paper §3.2; SYSTEM.md 1.5)", ["§3.2"]),
        ("src/webgym/core/task.py", "(paper §3.1)", ["§3.1"]),
        ("src/webgym/judge/blocking.py", "(paper §3.4)", []),
        ("src/webgym/judge/blocking.py", "(paper §4)", ["§4"]),
        ("src/webgym/server/admission.py", "(paper, section 4)", ["paper, section"]),
        ("src/webgym/agent/prompts.py", "(paper §5, appendix C and E)", []),
        ("src/webgym/agent/prompts.py", "(paper §5, appendix B and E)", ["appendix B"]),
        ("src/webgym/agent/prompts.py", "(paper §5, Appendix C)", ["Appendix C"]),
        ("docs/training.md", "(paper appendix G)", ["appendix G"]),
        ("docs/task-set.md", "paper Algorithm 2 and its Table 1", ["Algorithm 2"]),
        ("benchmarks/settle/hardweb/server.py", "RFC 6455, section 1.3", []),
    ],
)
def test_a_citation_of_a_wrong_section_is_found(name: str, text: str, wrong: list[str]) -> None:
    assert wrong_citations(name, text) == wrong
