"""Detects duplicate tasks, within a source and across sources (SOURCES.md, pitfall 5).

Only tasks on the same website (:func:`webgym.core.websites.site_of`) can be duplicates; all tasks whose
website is not known yet count as on one website. Two tasks are

* **the same** if their texts differ only in case, punctuation, white space and Unicode forms;
* **near** if, without function words and the website's own name, their words and pairs of adjacent words have
  a Jaccard similarity of at least :attr:`SIMILARITY`, and both have the same numbers and the
  same names in the same order. A different number or name makes a different task, however long the rest of
  the text: a template filled twice gives two tasks, and "Paris to Rome" is not "Rome to Paris".

Parents and their derived tasks are similar by construction, so members of one family can only be *the same*.
Near texts are found by prefix filtering (Bayardo et al., 2007): two texts of such similarity must share one
of their few rarest words or pairs. The result is exact except for the limit on comparisons per text. MinHash
with locality-sensitive hashing (datasketch, 128 permutations) takes four times as long and misses a quarter.
"""

from __future__ import annotations

import hashlib
import math
import re
import unicodedata
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Generic, Literal, TypeAlias, TypeVar

from webgym.core.settings import Settings
from webgym.core.task import Task
from webgym.core.websites import site_or_text
from webgym.tasks.files import gc_paused
from webgym.tasks.sources.base import SourceTask
from webgym.tasks.split import roots_of
from webgym.taskset.decompose import SYNTHETIC

AnyTask = TypeVar("AnyTask", Task, SourceTask)
Why: TypeAlias = Literal["same", "near", "parent", "template", "website"]
_Finding: TypeAlias = tuple[str, Why]

SIMILARITY = 0.85
"""Jaccard similarity of words and pairs of words from which two tasks are near. At the default, texts that
differ by one added word are near from about a dozen words on, by one replaced word from about twenty."""

PER_TEMPLATE = 20
"""Most tasks of a website whose texts differ only in numbers."""

PER_WEBSITE = 12_000
"""Most tasks of a website. PAE-WebVoyager has 128,499 on 13 websites, about 9,900 each (paper Table 1)."""

COMPARED = 100
"""Most texts that a text is compared with; those that share its rarest words come first."""


class DuplicateLimits(Settings):
    """What counts as a duplicate, which task is kept, and limits on synthetic sources."""

    sources: tuple[str, ...] = (
        "online-mind2web",
        "mind2web-2",
        "mind2web-live",
        "deepshop",
        "gaia-web",
        "browsecomp",
        "travelplanner",
        "webgym",
        "insta-v3",
        "agentsynth-web",
        "pae-webvoyager",
    )
    """Order of the sources: of two duplicates, the task of the earlier source is kept. The default puts human
    sources before synthetic ones, and smaller before larger. Sources that are not listed come first. Within a
    source the smaller id is kept."""
    synthetic: tuple[str, ...] = SYNTHETIC
    """Sources that the following limits apply to; derived tasks do not count. Their tasks are considered in a
    random order."""
    seed: int = 0
    """Seed of that random order."""


@dataclass(frozen=True, slots=True)
class DuplicateTask:
    """A task that was removed as a duplicate.

    Attributes:
        id, source: of the task.
        of: id of the kept task that it duplicates, or of the first task of its template, or of its removed
            parent; empty if its website has too many tasks.
        why: "same" text, "near" text, removed "parent", too many tasks of a "template" or on a "website".
    """

    id: str
    source: str
    of: str
    why: Why


@dataclass(frozen=True, slots=True)
class Deduplicated(Generic[AnyTask]):
    """The kept and the removed tasks, both in their original order."""

    kept: list[AnyTask]
    dropped: list[DuplicateTask]


@gc_paused()  # allocates millions of small objects without reference cycles
def drop_duplicates(tasks: Sequence[AnyTask], limits: DuplicateLimits | None = None) -> Deduplicated[AnyTask]:
    """Keep one task of each set of duplicates, and apply the limits on synthetic sources.

    Original tasks are considered before derived ones, so a derived task never replaces an original one. The
    derived tasks of a removed task are removed, too. The result does not depend on the order of the tasks.

    Args:
        tasks: with unique ids.
        limits: what counts as a duplicate; ``None`` for the defaults.
    """
    limits = limits or DuplicateLimits()
    parents = {task.id: task.parent_id for task in tasks if task.parent_id}
    roots = roots_of(tasks)
    texts = [_Text(task, roots.get(task.id, task.id)) for task in tasks]
    kept_texts, caps = _KeptTexts(texts, limits), _SyntheticLimits(limits)
    removed: dict[str, DuplicateTask] = {}
    for index in sorted(range(len(tasks)), key=_order(tasks, parents, limits)):
        task, text = tasks[index], texts[index]
        parent = parents.get(task.id)
        finding: _Finding | None = (parent, "parent") if parent is not None and parent in removed else None
        if finding is None:
            finding = kept_texts.repeated(text)
        if finding is None and parent is None and task.source in limits.synthetic:
            finding = caps.exceeded(text)
        if finding is None:
            kept_texts.keep(text)
        else:
            removed[task.id] = DuplicateTask(task.id, task.source, *finding)
    kept = [task for task in tasks if task.id not in removed]
    return Deduplicated(kept, [removed[task.id] for task in tasks if task.id in removed])


def _order(
    tasks: Sequence[Task | SourceTask], parents: Mapping[str, str], limits: DuplicateLimits
) -> Callable[[int], tuple[int, bool, int, bytes, str]]:
    """The sort key of a task: generation, test tasks before others, rank of the source, random order, id."""
    ranks = {source: rank for rank, source in enumerate(limits.sources)}

    def key(index: int) -> tuple[int, bool, int, bytes, str]:
        task = tasks[index]
        drawn = b""
        if task.source in limits.synthetic:
            drawn = hashlib.blake2b(f"{limits.seed}/{task.id}".encode(), digest_size=8).digest()
        rank = ranks.get(task.source, -1)
        return _generation(task.id, parents), task.split != "test", rank, drawn, task.id

    return key


def _generation(id: str, parents: Mapping[str, str]) -> int:
    """The number of ancestors of a task; in a cycle, each is counted once."""
    seen: set[str] = set()
    ancestor = id
    while ancestor in parents and ancestor not in seen:
        seen.add(ancestor)
        ancestor = parents[ancestor]
    return len(seen)


_NO_SHINGLES: Final = array("Q")


class _Text:
    """A task's text and its features, some of which are computed on demand."""

    __slots__ = ("_bag", "_names", "block", "family", "folded", "id", "key", "raw", "shingles", "site")

    def __init__(self, task: Task | SourceTask, family: str) -> None:
        self.id, self.raw, self.family = task.id, task.instruction, family
        self.folded = fold(task.instruction)
        self.site = "" if task.website is None else site_or_text(task.website)
        self.key = self.site, joined(self.folded)
        self.block = -1
        self.shingles = _NO_SHINGLES
        self._names: set[str] | None = None
        self._bag: frozenset[str] = frozenset()

    def words(self) -> list[str]:
        """All words except the website's own name."""
        own = self.site.partition(".")[0]
        words = self.folded.split()
        return [word for word in words if word != own] if own in words else words

    def has_same_particulars(self, other: _Text) -> bool:
        """Whether both have the same numbers and names in the same order."""
        own, others = self._name_words(), other._name_words()
        if not (own <= other._bag and others <= self._bag):
            return False  # a name in one does not occur in the other
        return self._particulars(own | others) == other._particulars(own | others)

    def _name_words(self) -> set[str]:
        """Its names except the website's own; cached, because a text is compared with many others."""
        if self._names is None:
            self._bag = frozenset(self.words())
            self._names = names(self.raw) & self._bag
        return self._names

    def _particulars(self, wanted: set[str]) -> list[str]:
        """Its numbers, and those of its words that are in ``wanted``, in order."""
        particulars = []
        for word in self.words():
            if (value := number(word)) is not None:
                particulars.append(value)
            elif word in wanted:
                particulars.append(word)
        return particulars


class _Numbers(dict[str, "str | None"]):
    """Cache: word to the number that it is or contains, or ``None``."""

    def __missing__(self, word: str) -> str | None:
        self[word] = value = number(word)
        return value


class _KeptTexts:
    """Index of the texts kept so far, for finding duplicates of a text.

    Only texts with the same website and the same numbers, a block, can be near; most blocks have a single
    family.
    """

    def __init__(self, texts: Sequence[_Text], limits: DuplicateLimits) -> None:
        self._limits = limits
        self._same: dict[tuple[str, str], str] = {}
        self._near: dict[tuple[int, int], list[_Text]] = {}
        self._crowded = self._set_blocks(texts)
        frequencies = Counter[str]()
        for text in texts:
            if text.block in self._crowded:
                frequencies.update(text.folded.split())
        self._all = _log_frequency(frequencies.total())
        self._words = {
            word: (0, 0) if word in FUNCTION_WORDS else (_log_frequency(frequencies[word]), code)
            for code, word in enumerate(sorted(frequencies), start=1)
        }

    @staticmethod
    def _set_blocks(texts: Sequence[_Text]) -> set[int]:
        """Set the block of every text; the blocks with several families."""
        numbers = _Numbers()
        blocks: dict[tuple[str, ...], int] = {}
        family: dict[int, str] = {}
        crowded: set[int] = set()
        for text in texts:
            values = sorted(value for word in text.words() if (value := numbers[word]) is not None)
            text.block = blocks.setdefault((text.site, *values), len(blocks))
            if family.setdefault(text.block, text.family) != text.family:
                crowded.add(text.block)
        return crowded

    def repeated(self, text: _Text) -> _Finding | None:
        """The id of a kept task that this one duplicates, and how; ``None`` if there is none."""
        same = self._same.get(text.key)
        if same is not None:
            return same, "same"
        if text.block in self._crowded:
            self._set_shingles(text)
            shingles = frozenset(text.shingles)
            for other in self._candidates(text):
                if self._is_similar(shingles, other) and text.has_same_particulars(other):
                    return other.id, "near"
        return None

    def keep(self, text: _Text) -> None:
        """Add a text to the index."""
        self._same[text.key] = text.id
        for shingle in self._prefix(text):
            self._near.setdefault((text.block, shingle), []).append(text)

    def _set_shingles(self, text: _Text) -> None:
        """Set the shingles of a text: a number for each word and pair of words, the rarer the smaller.

        The high bits are the frequency, the low bits identify the word or pair. The frequency of a pair is
        estimated from those of its words. The order only has to be the same for all texts; that rare shingles
        come first makes the search fast.
        """
        shingles: set[int] = set()
        last_frequency, last_code = 0, 0
        for word in text.words():
            frequency, code = self._words[word]
            if code:
                shingles.add(frequency << 48 | code)
                if last_code:
                    shingles.add(
                        max(last_frequency + frequency - self._all, 0) << 48 | last_code << 24 | code
                    )
                last_frequency, last_code = frequency, code
        text.shingles = array("Q", sorted(shingles))

    def _prefix(self, text: _Text) -> array[int]:
        shared = math.ceil(SIMILARITY * len(text.shingles) - 1e-9)
        return text.shingles[: len(text.shingles) - shared + 1] if text.shingles else _NO_SHINGLES

    def _candidates(self, text: _Text) -> Iterator[_Text]:
        seen: set[str] = set()
        least = SIMILARITY * len(text.shingles)
        most = len(text.shingles) / SIMILARITY
        for shingle in self._prefix(text):
            for other in self._near.get((text.block, shingle), ()):
                if (
                    least <= len(other.shingles) <= most
                    and other.family != text.family
                    and other.id not in seen
                ):
                    yield other
                    seen.add(other.id)
                    if len(seen) == COMPARED:
                        return

    def _is_similar(self, shingles: frozenset[int], other: _Text) -> bool:
        shared = len(shingles.intersection(other.shingles))
        return shared >= SIMILARITY * (len(shingles) + len(other.shingles) - shared)


def _log_frequency(count: int) -> int:
    """The logarithm of a frequency in eight bits, with a resolution of about a tenth of the frequency."""
    return round(8 * math.log2(count)) if count else 0


class _SyntheticLimits:
    """Counts of the kept tasks of synthetic sources."""

    def __init__(self, limits: DuplicateLimits) -> None:
        self._limits = limits
        self._templates: dict[tuple[str, str], tuple[str, int]] = {}
        self._websites: Counter[str] = Counter()

    def exceeded(self, text: _Text) -> _Finding | None:
        """The limit that a task would exceed; if it exceeds none, it is counted and ``None`` is returned."""
        key = (text.site, template(text.folded))
        first, count = self._templates.get(key, (text.id, 0))
        if count >= PER_TEMPLATE:
            return first, "template"
        if self._websites[text.site] >= PER_WEBSITE:
            return "", "website"
        self._templates[key] = (first, count + 1)
        self._websites[text.site] += 1
        return None


FUNCTION_WORDS: Final = frozenset(
    "a an the this that these those it its is are was be been of on in at for and as with which who please "
    "me my i you your we our can could would should will do does by so then there here about".split()
)
"""Words without influence on what a task asks for. "to", "from", "or", "not", "under" are not among them."""

_VALUES: Final = {
    word: str(value)
    for value, word in enumerate(
        "zero one two three four five six seven eight nine ten eleven twelve".split()
    )
}


class _Folding(dict[int, int | None]):
    """Table for ``str.translate``: punctuation, separators and control characters become spaces, apostrophes
    vanish.

    Symbols are kept ("C++" is not "C", "$" is not "€"), and so is "#": "C#" is not "C".
    """

    def __missing__(self, code: int) -> int | None:
        kind = unicodedata.category(chr(code))
        folded = kind[0] in "PZC" or kind == "Sk"
        self[code] = value = 32 if folded and code != ord("#") else code
        return value


_FOLDING: Final = _Folding(dict.fromkeys(map(ord, "'’‘ʼ`´")))
_THOUSANDS: Final = re.compile(r"(?<=\d),(?=\d{3}(?!\d))")
_TWO_NUMBERS: Final = re.compile(r"\d \d")
_NOT_BETWEEN_DIGITS: Final = re.compile(r"(?<!\d) | (?!\d)")
_DIGITS: Final = re.compile(r"\d+(?: \d+)*")
_WORD: Final = re.compile(r"(?<![\w'’])[^\W\d_][\w'’+#]*")
_BEGINNING: Final = re.compile(r"(?:\A|[.!?:;\"“(]\s*)\Z")


def fold(text: str) -> str:
    """The words of a text in a normal form: Unicode NFKC, lower case, no punctuation, single spaces.

    A text without words is returned stripped.
    """
    if not text.isascii():
        text = unicodedata.normalize("NFKC", text)
    if "," in text:
        text = _THOUSANDS.sub("", text)
    return " ".join(text.casefold().translate(_FOLDING).split()) or text.strip()


def joined(folded: str) -> str:
    """A folded text without white space, in which sources differ ("Fox Sports", "foxsports")."""
    if _TWO_NUMBERS.search(folded):
        return _NOT_BETWEEN_DIGITS.sub("", folded)
    return folded.replace(" ", "")


def template(folded: str) -> str:
    """A folded text with every number replaced by 0."""
    return _DIGITS.sub("0", folded)


def number(word: str) -> str | None:
    """The number that a folded word is or contains; ``None`` if it contains no digit and is no number
    word."""
    if word.isalpha():
        return _VALUES.get(word)
    return word if any(map(str.isdigit, word)) else None


def names(text: str) -> set[str]:
    """The words that look like names, folded: a capital inside a sentence, or capitals throughout."""
    text = unicodedata.normalize("NFKC", text)
    folded = set()
    for match in _WORD.finditer(text):
        word = match.group()
        begins = _BEGINNING.search(text, max(0, match.start() - 8), match.start()) is not None
        if word[0].isupper() and (not begins or (len(word) > 1 and word.isupper())):
            folded.update(fold(word).split())
    return folded - {"i"}
