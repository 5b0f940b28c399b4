"""Word stock of the job boards: sectors with their fields, roles, and what they ask for."""

from __future__ import annotations

from webgym.offline.data import Table, load


class Sector(Table, frozen=True):
    """What a job board is about.

    Attributes:
        suffixes: second words of brands.
        taglines: one is taken.
        fields: parts of the sector with their roles.
        specials: what stands before a role.
        skills: what adverts ask for.
        papers: certificates that adverts ask for.
        duties: what one does there.
        companies: second words of employers.
        pay: yearly pay of a middling role, in thousands.
        shifts: whether its adverts name shifts rather than say from where one works.
    """

    suffixes: tuple[str, ...]
    taglines: tuple[str, ...]
    fields: dict[str, tuple[str, ...]]
    specials: tuple[str, ...]
    skills: tuple[str, ...]
    papers: tuple[str, ...]
    duties: tuple[str, ...]
    companies: tuple[str, ...]
    pay: int
    shifts: bool = False


class Advice(Table, frozen=True):
    """A piece of advice: steps with ``{key}`` in one, and what that may be."""

    title: str
    steps: tuple[str, ...]
    keys: tuple[str, ...]


class Words(Table, frozen=True):
    """``words.toml``.

    Attributes:
        stages: how far an application has come.
    """

    benefits: tuple[str, ...]
    stages: tuple[str, ...]
    advice: tuple[Advice, ...]
    sectors: dict[str, Sector]


WORDS = load("webgym.offline.families.jobs", "words.toml", Words)
