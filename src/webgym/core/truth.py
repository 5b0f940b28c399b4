"""The ground truth of a task of the offline web, which no model is ever shown.

A :class:`Truth` says which page states show which fact, which state the server must end up in, which
answers are right, and which moves solve the task by clicking, typing and scrolling alone.
"""

from __future__ import annotations

from typing import Any, Final, Literal, TypeAlias

import msgspec

# --- moves: the steps of a solution, for a closed loop that observes the page after each ----------


class Home(
    msgspec.Struct, frozen=True, tag_field="do", tag="home", omit_defaults=True, repr_omit_defaults=True
):
    """Go to a website's front page; does nothing when already there.

    Attributes:
        url: URL of the front page; ``""`` is the task's own website.
    """

    url: str = ""


class Click(msgspec.Struct, frozen=True, tag_field="do", tag="click", omit_defaults=True):
    """Click the element with this accessible name (whole, case folded) or this link path.

    Attributes:
        name: accessible name; ``None`` to match by ``path`` alone.
        role: ARIA role that the element must have; ``None`` for any.
        path: path and query of a link's target, e.g. ``"/p/12"``.
    """

    name: str | None = None
    role: str | None = None
    path: str | None = None


class Fill(msgspec.Struct, frozen=True, tag_field="do", tag="fill"):
    """Type into the field with this accessible name. Typing ends with Enter, which submits a form."""

    field: str
    text: str


class Choose(msgspec.Struct, frozen=True, tag_field="do", tag="choose"):
    """Pick an option, by its text, in the dropdown with this accessible name."""

    field: str
    option: str


class See(msgspec.Struct, frozen=True, tag_field="do", tag="see"):
    """Scroll until all of these texts are visible at once."""

    texts: tuple[str, ...]


class Back(msgspec.Struct, frozen=True, tag_field="do", tag="back"):
    """Go one page back."""


class Remember(msgspec.Struct, frozen=True, tag_field="do", tag="remember"):
    """Write an entry into the agent's memory: it is visible now, and will be needed when it is not.

    Attributes:
        key: key of the entry.
        value: value of the entry.
    """

    key: str
    value: str


class Done(msgspec.Struct, frozen=True, tag_field="do", tag="done"):
    """Mark a part of the task as finished. A solution marks every part, or none.

    Attributes:
        part: the part's key in the agent's progress, ``"1"`` for the first.
    """

    part: str


class Give(msgspec.Struct, frozen=True, tag_field="do", tag="give"):
    """Give the answer."""

    text: str


Move: TypeAlias = Home | Click | Fill | Choose | See | Back | Remember | Done | Give

# --- what counts as proof ---------------------------------------------------------------------------


class Evidence(msgspec.Struct, frozen=True, omit_defaults=True, repr_omit_defaults=True):
    """A view that confirms a fact: on one website, all texts visible in one and the same observation.

    Attributes:
        texts: compared as whole words, ignoring case and white space.
        path: regular expression that the URL's path and query must match from its start; ``""`` matches any.
        host: hostname of the website; ``""`` is :attr:`Truth.host`.
    """

    texts: tuple[str, ...]
    path: str = ""
    host: str = ""


class StateCheck(msgspec.Struct, frozen=True):
    """A value that the website's server must hold at the end of the attempt.

    Attributes:
        key: path into the state that the website reports, e.g. ``("cart", "Blue Mug")``.
        value: the expected value; ``None`` if the key must be absent or empty.
    """

    key: tuple[str, ...]
    value: Any = None


class FactTruth(msgspec.Struct, frozen=True, omit_defaults=True):
    """How one fact is confirmed.

    Attributes:
        group: id of the fact's group.
        index: the fact's index in its group, from 0.
        evidence: views, any one of which must have been seen.
        state: checks, all of which must hold.
    """

    group: int
    index: int
    evidence: tuple[Evidence, ...] = ()
    state: tuple[StateCheck, ...] = ()


DONE: Final = "done"
"""The answer to a task that asks for no value."""


class AnswerTruth(msgspec.Struct, frozen=True, omit_defaults=True):
    """Which answer is right: the values alone, in the order in which the task asks for them.

    Attributes:
        required: the spellings of each value, the one on pages first; empty if the task asks for none.
        others: other candidates, none of which is right, for policies that answer wrongly on purpose.
        by_comma: whether commas separate values too, as line ends do; no spelling then contains one.
    """

    required: tuple[tuple[str, ...], ...] = ()
    others: tuple[str, ...] = ()
    by_comma: bool = False

    @property
    def values(self) -> tuple[tuple[str, ...], ...]:
        """What the answer consists of: the required values, or the word :data:`DONE` if there are none."""
        return self.required or ((DONE,),)


class Truth(msgspec.Struct, frozen=True, omit_defaults=True):
    """The ground truth of one task.

    Attributes:
        host: hostname of the website whose server's state is checked, and of evidence that names no host.
        facts: one entry for every fact of the rubric.
        answer: what the answer must say.
        moves: a solution, from the start page to the answer.
        expects: the outcome of an attempt that carries out the solution. Tasks of a website that blocks bots,
            or is down, cannot succeed.
    """

    host: str
    facts: tuple[FactTruth, ...]
    answer: AnswerTruth
    moves: tuple[Move, ...]
    expects: Literal["success", "blocked", "environment_error", "judge_error"] = "success"

    @property
    def hosts(self) -> frozenset[str]:
        """Hostnames of all websites that the task is about."""
        views = [evidence for fact in self.facts for evidence in fact.evidence]
        return frozenset({self.host, *(view.host for view in views if view.host)})
