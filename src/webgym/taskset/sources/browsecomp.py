"""BrowseComp: short answers that are hard to find. Published encrypted, to keep them out of crawls.

Every task has the flag :data:`~webgym.taskset.sources.base.ENCRYPTED_SOURCE`: it is not written to a file
unless the user requests the source by name. No message quotes the tasks.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import unicodedata

from webgym.taskset.sources.base import ENCRYPTED_SOURCE, Draft, Source
from webgym.taskset.sources.categories import UNKNOWN, Place, named, subdomain
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.fields import Fields
from webgym.taskset.sources.problems import Unusable

_INSTRUCTION = ("problem", "question")
_PLACES: dict[str, Place] = {
    "tv shows & movies": subdomain("Films & TV Shows"),
    "music": subdomain("Music"),
    "video games": subdomain("Gaming & Virtual Worlds"),
    "sports": subdomain("Sports & Fitness"),
    "science & technology": subdomain("Technology & Science"),
}
"""Taxonomy by ``problem_topic``. The other topics (art, geography, history, ...) match no single
subdomain."""


def decrypt(cipher: str, canary: str) -> str:
    """Decrypt a field: XOR with the SHA-256 of the canary, repeated.

    Raises:
        Unusable: it cannot be decrypted: the canary is of another row, or the field is damaged or not
            encrypted.
    """
    try:
        data = base64.b64decode("".join(cipher.split()), validate=True)
    except (binascii.Error, ValueError) as error:
        raise Unusable("it is not encrypted as in BrowseComp: it is not base64") from error
    digest = hashlib.sha256(canary.encode()).digest()
    key = digest * (len(data) // len(digest) + 1)
    try:
        plain = bytes(a ^ b for a, b in zip(data, key, strict=False)).decode()
    except UnicodeDecodeError as error:
        raise Unusable("it does not decrypt with its canary") from error
    if any(unicodedata.category(letter) == "Cc" and letter not in "\t\r\n" for letter in plain):
        raise Unusable("it does not decrypt with its canary")
    return plain.strip()


def _draft(fields: Fields, _: Companions) -> Draft:
    cipher = fields.instruction(*_INSTRUCTION)
    # Not stripped: the key is the hash of all these characters.
    canary = fields.value("canary")
    if not isinstance(canary, str):
        raise Unusable("no 'canary' to decrypt with")
    question = decrypt(cipher, canary)
    if not question:
        raise Unusable("'problem' is empty")
    draft = Draft(question, fields.native_id("id"), flags=[ENCRYPTED_SOURCE])
    answer = fields.text("answer")
    draft.reference_answer = (decrypt(answer, canary) or None) if answer else None
    topic = fields.value("problem_topic")
    draft.domain, draft.subdomain = _place(topic)
    return draft


def _place(topic: object) -> Place:
    if not isinstance(topic, str):
        return UNKNOWN
    return _PLACES.get(topic.strip().casefold().replace(" and ", " & "), named(topic))


SOURCE = Source(
    name="browsecomp",
    paper_tasks=1_266,
    paper_websites=7,
    licence="MIT (code)",
    instruction=_INSTRUCTION,
    draft=_draft,
    marks=(("problem", "canary"),),
    timeless=True,
)
