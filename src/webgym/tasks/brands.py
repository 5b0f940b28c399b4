"""Websites that belong to one brand: ``amazon.com``, ``amazon.de`` and ``amazon.co.uk``.

Websites are usually compared by registrable domain (:func:`webgym.core.websites.site_of`). For keeping
training and test apart that is too fine: a brand's website looks and works alike in every country. So the
split, the check for leaks and the weights that spread draws over websites compare brands. Counts, duplicates
and the record of health compare websites: ``amazon.de`` may block an agent where ``amazon.com`` does not.

**The rule.** Two registrable domains are one brand if they differ only in an *open* suffix: a
top-level domain (``.com``, ``.de``, ``.shop``), or a commercial second level of a country (``co.uk``,
``com.br``, ``ne.jp``). Not merged are

- institutions, whose labels repeat from country to country (``health.gov.uk`` and ``health.gov.au``,
  ``cambridge.ac.uk`` and ``cambridge.edu``): their top-level domains and every second level that is not
  commercial;
- customers of a hosting service (``alice.github.io``), as listed in the Public Suffix List;
- labels of up to three characters, which different owners have in different countries
  (``abc.com``, ``abc.net.au``, ``abc.es``), except :data:`SHORT_BRANDS`;
- labels that are common words rather than a company's name (``news.com.au`` and ``news.de``): :data:`THINGS`.

**Errors.** It merges unrelated owners of the same longer name (``delta.com``, an airline, and ``delta.nl``, a
cable network); that only removes a few websites from training without need. It does not merge a brand whose
names differ by more than the suffix (``tk-maxx.de`` and ``tjmaxx.com``), nor short names and common words
that the lists lack or have wrongly (``target.com.au`` is another company's; ``time.com`` is not ``time.is``).
When in doubt it merges: a website missing from training does less harm than a test website in it.
"""

from __future__ import annotations

import tomllib
from functools import cache, lru_cache
from pathlib import Path
from typing import Final

from publicsuffixlist import PublicSuffixList

from webgym.core.websites import site_of

_LISTS: Final = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
SHORT_BRANDS: Final = frozenset(_LISTS["short"].split())
"""Labels of up to three characters that one company has in many countries."""
THINGS: Final = frozenset(_LISTS["things"].split())
"""Labels that are common words, which have unrelated owners in several countries."""
SAME: Final[dict[str, str]] = _LISTS["same"]
"""Websites of a brand under another label, and that brand."""

_INSTITUTIONS: Final = frozenset("arpa edu gov int mil museum".split())
_COMMERCIAL: Final = frozenset(
    "biz co com firm gen in info ltd me ne net nom or org plc shop store web".split()
)
_SHORT_LABEL_CHARS: Final = 3
_CACHED_WEBSITES: Final = 2**19


@lru_cache(_CACHED_WEBSITES)
def brand_of(website: str) -> str:
    """The brand that a bare host or a URL belongs to, as a name for comparison. Cached.

    Returns:
        A name such as ``amazon.*``; the registrable domain, as from :func:`~webgym.core.websites.site_of`,
        where no other website can be of its brand.

    Raises:
        ValueError: the text has no host.
    """
    site = site_of(website)
    if site in SAME:
        return SAME[site]
    suffix = _suffixes().publicsuffix(site)
    if suffix is None or suffix == site:
        return site
    label = site.removesuffix(f".{suffix}")
    is_known = label in SHORT_BRANDS if len(label) <= _SHORT_LABEL_CHARS else label not in THINGS
    return f"{label}.*" if "." not in label and is_known and _is_open(suffix) else site


def brand_or_text(website: str) -> str:
    """As :func:`brand_of`, but a text that does not name a website is returned unchanged."""
    try:
        return brand_of(website)
    except ValueError:
        return website


def _is_open(suffix: str) -> bool:
    """Whether anybody can register a name under this suffix."""
    second, _, top = suffix.rpartition(".")
    return second in _COMMERCIAL if second else top not in _INSTITUTIONS


@cache
def _suffixes() -> PublicSuffixList:
    """The suffixes of registries only, without those of hosting services."""
    return PublicSuffixList(only_icann=True, accept_unknown=False)
