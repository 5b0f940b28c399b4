"""How large the project may be: figures of the tree, held against the limits in ``ratchets.toml``.

A limit may fall in any commit. It rises only in a commit that brings a capability that was asked for, and
whose message says so; it is then edited by hand.

    python scripts/ratchets.py            exits with 1 and one line per figure above its limit
    python scripts/ratchets.py --lower    writes the figures that are below their limits as the new limits
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

import grimp

ROOT = Path(__file__).resolve().parent.parent
LIMITS = "ratchets.toml"

ADVICE = {
    "src_lines": "remove lines of Python from src, or say in the commit which capability they bring",
    "src_files": "merge files in src that are one thought",
    "test_lines": "write the tests as a table, or remove those of deleted code",
    "docs_words": "cut docs/*.md and README.md to what a user needs",
    "changelog_words": "cut CHANGELOG.md to what a user of the next release must know",
    "loose_modules": "move the module into a folder of src/webgym",
    "one_importer": "merge the file into the only one that imports it",
    "settings": "make the setting a constant beside its use",
    "unnamed_settings": "name the setting in a config, page, command or test, or make it a constant",
    "longest_word_list": "replace the list in src by a contract or a data file",
}
"""What is measured, and what to do about a figure above its limit."""

NAMING = ("configs", "docs", "examples", "deploy", "benchmarks", "tests", "src/webgym/cli", "README.md")
"""Where a setting is named by somebody who sets it."""
TEXTS = {".md", ".py", ".toml", ".yaml"}

NAMED = re.compile(r"""\b([a-z]\w*)\s*[:=]|[`"'.]([a-z][\w.]*)\b""")
"""A name that is set or quoted, and not only a word of a sentence."""

ALTERNATIVES = re.compile(r"[\w' -]+(?:\|[\w' -]+)+")


def measure(root: Path) -> dict[str, int]:
    """Every figure of a checkout, under the names of :data:`ADVICE`."""
    source = {path: path.read_text("utf-8") for path in sorted((root / "src").rglob("*.py"))}
    trees = {path: list(ast.walk(ast.parse(text))) for path, text in source.items()}
    modules = {".".join(path.relative_to(root / "src").with_suffix("").parts): trees[path] for path in trees}
    settings = list(fields(modules))
    named = names_in(root)
    return {
        "src_lines": sum(text.count("\n") for text in source.values()),
        "src_files": len(source),
        "test_lines": sum(path.read_text("utf-8").count("\n") for path in (root / "tests").rglob("*.py")),
        "docs_words": sum(words_of(path) for path in [*(root / "docs").glob("*.md"), root / "README.md"]),
        "changelog_words": words_of(root / "CHANGELOG.md"),
        "loose_modules": sum(not path.stem.startswith("__") for path in (root / "src/webgym").glob("*.py")),
        "one_importer": one_importer(),
        "settings": len(settings),
        "unnamed_settings": sum(name not in named for name in settings),
        "longest_word_list": max(
            (words_in(node) for path, nodes in trees.items() if path.name != "__init__.py" for node in nodes),
            default=0,
        ),
    }


def words_of(path: Path) -> int:
    """Words of a document, as ``wc -w`` counts them."""
    return len(path.read_text("utf-8").split())


def one_importer() -> int:
    """Modules of the package that exactly one other imports."""
    sys.path.insert(0, str(ROOT / "src"))
    graph = grimp.build_graph("webgym")
    return sum(len(graph.find_modules_that_directly_import(module)) == 1 for module in graph.modules)


def subclasses(modules: Mapping[str, list[ast.AST]]) -> set[tuple[str, str]]:
    """Module and name of each class whose bases lead to ``Settings``."""
    bases: dict[tuple[str, str], set[tuple[str, str]]] = {}
    for module, nodes in modules.items():
        imported = {
            name.asname or name.name: (str(node.module), name.name)
            for node in nodes
            if isinstance(node, ast.ImportFrom)
            for name in node.names
        }
        for node in nodes:
            if isinstance(node, ast.ClassDef):
                above = [base.id for base in node.bases if isinstance(base, ast.Name)]
                bases[module, node.name] = {imported.get(name, (module, name)) for name in above}
    known = {each for each in bases if each[1] == "Settings"}
    while grown := {each for each, above in bases.items() if above & known} - known:
        known |= grown
    return known


def fields(modules: Mapping[str, list[ast.AST]]) -> Iterator[str]:
    """The settings that the classes of all modules declare."""
    classes = subclasses(modules)
    for module, nodes in modules.items():
        for node in nodes:
            if isinstance(node, ast.ClassDef) and (module, node.name) in classes:
                for item in node.body:
                    match item:
                        case ast.AnnAssign(target=ast.Name(id=name)) if "ClassVar" not in ast.unparse(item):
                            yield name


def names_in(root: Path) -> set[str]:
    """Every name that the files of :data:`NAMING` set or quote."""
    places = [root / place for place in NAMING]
    files = [path for place in places for path in ([place] if place.is_file() else place.rglob("*"))]
    texts = (
        path.read_text("utf-8") for path in files if path.suffix in TEXTS and "generated" not in path.parts
    )
    found = (match for text in texts for match in NAMED.finditer(text.replace("-", "_")))
    return {name for match in found for name in (match[1] or match[2]).split(".")}


def words_in(node: ast.AST) -> int:
    """How many words a collection, a split text or the alternatives of a pattern spell out."""
    match node:
        case ast.List(elts=held) | ast.Tuple(elts=held) | ast.Set(elts=held) | ast.Dict(keys=held):
            plain = all(isinstance(each, ast.Constant) and isinstance(each.value, str) for each in held)
            return len(held) if plain else 0
        case ast.Call(func=ast.Attribute(value=ast.Constant(value=str(text)), attr="split" | "splitlines")):
            return len(text.split())
        case ast.Constant(value=str(text)):
            return max((each.count("|") + 1 for each in ALTERNATIVES.findall(text)), default=0)
    return 0


def read_limits(root: Path) -> dict[str, int]:
    """The limits of a checkout."""
    limits: dict[str, int] = tomllib.loads((root / LIMITS).read_text("utf-8"))
    return limits


def above(figures: Mapping[str, int], limits: Mapping[str, int]) -> list[str]:
    """One line for each figure above its limit."""
    return [
        f"{name} is {figures[name]}, its limit {limit}: {ADVICE[name]}"
        for name, limit in limits.items()
        if figures[name] > limit
    ]


def lower(root: Path, figures: Mapping[str, int]) -> list[str]:
    """Write figures that are below their limits as the new limits; the names of those that fell."""
    limits = read_limits(root)
    fell = [name for name, limit in limits.items() if figures[name] < limit]
    text = (root / LIMITS).read_text("utf-8")
    for name in fell:
        text = re.sub(rf"^{name} = \d+", f"{name} = {figures[name]}", text, flags=re.MULTILINE)
    (root / LIMITS).write_text(text, "utf-8")
    return fell


def main() -> int:
    """Hold the figures against the limits; 1 if one is above its limit."""
    figures, limits = measure(ROOT), read_limits(ROOT)
    if "--lower" in sys.argv[1:]:
        print("lowered:", ", ".join(lower(ROOT, figures)) or "nothing")
    elif below := [name for name, limit in limits.items() if figures[name] < limit]:
        print(f"below their limits, lower them with scripts/ratchets.py --lower: {', '.join(below)}")
    too_many = above(figures, limits)
    for line in too_many:
        print(line)
    return 1 if too_many else 0


if __name__ == "__main__":
    sys.exit(main())
