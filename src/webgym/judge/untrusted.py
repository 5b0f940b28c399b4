"""Quotation of untrusted text, so that a judge model cannot take it for instructions.

Pages, answers and whatever an agent typed are untrusted: they may address the judge, pretend to be the
end of the quotation, or forge a verdict. A quotation is fenced by lines with a code, and each of its own
lines begins with a bar. The code is a digest of everything in the request, the quoted text included:
nobody can write a text that contains the digest of itself, and the same request has the same code, so
that replies can be cached.
"""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Iterable
from typing import Final

CODE_CHARS: Final = 12
"""48 bits: to guess the code of one request takes 10^14 tries, and a try is a request."""

_KEPT: Final = frozenset("\t\u200c\u200d")
"""Joiners belong to scripts and emoji."""

_HIDDEN: Final = frozenset({"Cc", "Cf", "Co", "Cs", "Cn"})
_CONTROL_TOKEN: Final = re.compile(r"<(?=\||/?(?:s|im_start|im_end|think|image|vision)\b)", re.IGNORECASE)


def code_of(*content: str) -> str:
    """The code of a request with this content."""
    digest = hashlib.sha256()
    for part in content:
        data = part.encode("utf-8", "replace")
        digest.update(len(data).to_bytes(8, "big") + data)
    return digest.hexdigest()[:CODE_CHARS]


def visible(text: str) -> str:
    """The text without characters that a reader would not see and without chat templates' control tokens."""
    shown = "".join(
        character if character in _KEPT or unicodedata.category(character) not in _HIDDEN else "\ufffd"
        for character in text
    )
    return _CONTROL_TOKEN.sub("< ", shown)


def shorten(text: str, limit: int) -> str:
    """At most about ``limit`` characters of a text: its beginning and its end."""
    if len(text) <= limit:
        return text
    half = limit // 2
    left_out = len(text) - 2 * half
    return f"{text[:half]}\n[{left_out} characters left out]\n{text[len(text) - half :]}"


def quote(label: str, text: str, code: str) -> str:
    """A text as a quotation that cannot be closed from inside."""
    lines = _barred(text.splitlines() or [""])
    return "\n".join((f"<<{label} {code}>>", *lines, f"<<end of {label} {code}>>"))


def _barred(lines: Iterable[str]) -> Iterable[str]:
    return (f"| {visible(line)}" for line in lines)
