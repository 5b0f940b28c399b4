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
from typing import Final

from webgym.core.text import visible

CODE_CHARS: Final = 12
"""Length of a code; 48 bits, so guessing the code of one request takes about 10^14 requests."""


def code_of(*content: str) -> str:
    """The code of a request with these texts: :data:`CODE_CHARS` hexadecimal digits."""
    digest = hashlib.sha256()
    for part in content:
        data = part.encode("utf-8", "replace")
        digest.update(len(data).to_bytes(8, "big") + data)
    return digest.hexdigest()[:CODE_CHARS]


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
    lines = (f"| {visible(line)}" for line in text.splitlines() or [""])
    return "\n".join((f"<<{label} {code}>>", *lines, f"<<end of {label} {code}>>"))
