"""What no tracked file may hold: a path of somebody's machine, or the place packages come from.

A checkout must work anywhere, so nothing in it may name this checkout's folder or the user's home; and who
installs the locked packages decides from where, so no file names a package index or its settings.

    python scripts/check_tree.py        exits with 1 and one line per finding: file, line, what
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

LARGEST_FILE_MIB = 2
LARGER = {Path("src/webgym/study/weights/model.safetensors"): 8}
"""Files that may have more, MiB."""
LOCK_LINE = re.compile(r"(#.*|([\w.-]+==[\w.!+-]+( ; [^@/]+)?|    --hash=sha256:[0-9a-f]{64})( \\)?)?")

FORBIDDEN = {
    "a home directory": re.compile(r"(?<![\w.])/(?:root|Users/\w+)/"),
    "a package index": re.compile(r"\b(?:pypi|pythonhosted|npmjs|debian|ubuntu)\.(?:org|com|net)\b"),
    "a package index setting": re.compile(r"(?:extra-)?index-url\b|\bfind-links\b"),
}


def tracked_files(root: Path) -> list[Path]:
    """Every file that git would commit: tracked, or new and not ignored."""
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=root,
        check=True,
        capture_output=True,
        text=True,
    )
    names = (root / name for name in listing.stdout.split("\0") if name)
    return [path for path in names if path.is_file()]


def this_machine(root: Path) -> dict[str, re.Pattern[str]]:
    """The folders of the machine that the check runs on."""
    # A folder right under the root, as in a container, has a name too common to look for.
    folders = [re.escape(str(folder)) for folder in (root, Path.home()) if len(folder.parts) > 2]
    if not folders:
        return {}
    return {"a folder of this machine": re.compile(rf"(?<![\w./])(?:{'|'.join(folders)})\b")}


def findings(root: Path) -> Iterator[str]:
    """One line for each thing that must not be there."""
    forbidden = FORBIDDEN | this_machine(root)
    for path in tracked_files(root):
        name = path.relative_to(root)
        if path.stat().st_size > (most := LARGER.get(name, LARGEST_FILE_MIB)) * 2**20:
            yield f"{name}: larger than {most} MiB"
            continue
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue  # a picture or a font
        if name.parts[0] == "requirements":
            for number, line in enumerate(text.splitlines(), start=1):
                if not LOCK_LINE.fullmatch(line):
                    yield f"{name}:{number}: a lock line is name==version or a hash, nothing else"
        if path != Path(__file__).resolve():  # the patterns themselves
            for what, pattern in forbidden.items():
                for match in pattern.finditer(text):
                    yield f"{name}:{text.count(chr(10), 0, match.start()) + 1}: holds {what}: {match[0]}"


def main() -> int:
    """Print the findings; 1 if there are any."""
    found = list(findings(ROOT))
    for line in found:
        print(line)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
