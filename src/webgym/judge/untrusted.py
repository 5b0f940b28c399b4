"""Quotation of untrusted text, so that a judge model cannot take it for instructions.

Pages, answers and whatever an agent typed are untrusted: they may address the judge, pretend to be the
end of the quotation, or forge a verdict. A quotation stands between two lines with a code, and each of its
own lines begins with a bar. The code is a digest of everything in the request, including the quoted text:
nobody can write a text that contains its own digest. The same request has the same code, so replies can be
cached.
"""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Iterable
from typing import Final

CODE_CHARS: Final = 12
"""Length of a code; 48 bits, so guessing the code of one request takes about 10^14 requests."""

_KEPT: Final = frozenset("\t\u200c\u200d")
"""Invisible characters that are kept: joiners are part of scripts and emoji."""

_HIDDEN: Final = frozenset({"Cc", "Cf", "Co", "Cs", "Cn"})
_CONTROL_TOKEN: Final = re.compile(
    r"<(?=[|｜]|/?(?:s|think|thinking|thought)\b)"
    r"|<(?=/?(?:image|img|video|audio|vision|bos|eos|pad|unk|mask|sys|[a-z]+_\w+)\b)"
    r"|◁(?=/?think▷)"
    r"|\[(?=/?(?-i:INST|IMG|THINK|[A-Z]+_[A-Z_]+)\])",
    re.IGNORECASE,
)
"""The start of what may be a control token: no tag of HTML has an underscore."""


def code_of(*content: str) -> str:
    """The code of a request with these texts: :data:`CODE_CHARS` hexadecimal digits."""
    digest = hashlib.sha256()
    for part in content:
        data = part.encode("utf-8", "replace")
        digest.update(len(data).to_bytes(8, "big") + data)
    return digest.hexdigest()[:CODE_CHARS]


def visible(text: str) -> str:
    """The text with invisible characters replaced by U+FFFD and control tokens of chat templates broken
    up."""
    shown = "".join(
        character if character in _KEPT or unicodedata.category(character) not in _HIDDEN else "\ufffd"
        for character in text
    )
    return _CONTROL_TOKEN.sub(r"\g<0> ", shown)


def shorten(text: str, limit: int) -> str:
    """At most about ``limit`` characters of a text: its beginning and its end."""
    if len(text) <= limit:
        return text
    half = limit // 2
    left_out = len(text) - 2 * half
    return f"{text[:half]}\n[{left_out} characters left out]\n{text[len(text) - half :]}"


def in_parts(text: str, limit: int) -> list[str]:
    """The whole text in parts of at most ``limit`` characters (at least 200), each of which begins with the
    last eighth of the one before; cut between lines where possible, else between sentences or words."""
    if len(text) <= limit:
        return [text]
    most = limit // 8 - 2
    some = f".{{{most // 2},{most}}}"
    cuts = rf"{some}\n|{some}[.!?]\s|{some}[。！？]|{some}\s|.{{1,{most}}}"
    pieces = re.findall(cuts, text, re.DOTALL)
    return ["".join(pieces[start : start + 8]) for start in range(0, len(pieces) - 1, 7)]


def quote(label: str, text: str, code: str) -> str:
    """The text as a quotation that nothing in it can end."""
    lines = _barred(text.splitlines() or [""])
    return "\n".join((f"<<{label} {code}>>", *lines, f"<<end of {label} {code}>>"))


def _barred(lines: Iterable[str]) -> Iterable[str]:
    return (f"| {visible(line)}" for line in lines)
