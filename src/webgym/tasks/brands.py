"""Which websites belong together under one name: ``amazon.com``, ``amazon.de`` and ``amazon.co.uk``.

A registrable domain (:func:`webgym.core.websites.site_of`) tells one website from another; for what a policy
may have trained on that is too fine. A brand's website looks and works alike in every country, so the split,
the guard against leaks and whatever spreads tasks evenly over websites ask for the brand. Counts, duplicates
and the blocklist go on asking for the website: ``amazon.de`` may block where ``amazon.com`` does not.

**The rule.** Two registrable domains are one brand if they differ in nothing but an *open* suffix: a
top-level domain (``.com``, ``.de``, ``.shop``), or a commercial second level of a country (``co.uk``,
``com.br``, ``ne.jp``). Apart stay

- institutions, whose labels repeat from country to country (``health.gov.uk`` and ``health.gov.au``,
  ``cambridge.ac.uk`` and ``cambridge.edu``), with their top-level domains and every second level that is not
  commercial;
- customers of a hosting service (``alice.github.io``), which the Public Suffix List names;
- labels of up to three characters, which are scarce everywhere and belong to whoever came first
  (``abc.com``, ``abc.net.au``, ``abc.es``), but for :data:`SHORT_BRANDS`;
- labels that name a thing rather than a company (``news.com.au`` and ``news.de``): :data:`THINGS`.

**What it gets wrong.** It merges strangers who share a longer name (``delta.com``, an airline, and
``delta.nl``, a cable network); that takes a few websites out of training that need not go, and costs nothing
else. It does not merge a brand whose names differ by more than the suffix (``tk-maxx.de`` and
``tjmaxx.com``), nor short ones and words that the lists lack or hold wrongly (``target.com.au`` is another
company's; ``time.com`` is not ``time.is``). Where in doubt it merges: a website too few in training is a
smaller fault than a test website in it.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Final

from publicsuffixlist import PublicSuffixList

from webgym.core.websites import site_of

SHORT_BRANDS: Final = frozenset(
    "3m abb adp aon axa bbc bmw bp cnn dhl dsw epa ey gap ge h-m hm hp ibm ing jll kfc kia lg mac mtv"
    " nec o2 obi olx pwc qvc sap sas tcl tnt tui ubs ups uss vw wmf".split()
)
"""Labels of up to three characters that one company has in many countries. (Longer ones do no harm.)"""

THINGS: Final = frozenset(
    """
    academy admin agency airport airports apartments apps archive arts auction auctions auto autos baby
    bank bazaar beauty best bikes blog blogs board boats books business calendar camping career careers
    cars casino cats catalog cinema city classifieds clinic cloud club coffee college community compare
    contact cooking coupons courses craft crafts credit data dating deals delivery dentist design
    dictionary diet directory docs doctor doctors dogs domain domains download earth education electric
    email energy engineering events expert experts express fashion film films finance find fishing
    fitness flights flowers food football forum forums free furniture gallery games garden gardening
    gifts global golf government green group guide hair health help herald hiking history home homes
    hospital hotel hotels house housing image images independent info insider institute insurance
    international internet invest investing jewelry jobs journal kids kitchen land laptops law lawyer
    lawyers learn learning legal library life list live living loans local love luxury magazine mail
    maps market marketplace markets math media medical metro mirror mobile models money mortgage motors
    movie movies museum music national nature network news nursing office online outdoor parents parking
    parks parliament parts people pets pharmacy phone phones photo photos pizza play podcast podcasts
    poetry police portal post posters press price prices property public radio realestate recipe recipes
    records rent rental rentals research restaurant restaurants reviews running sale sales school
    schools science search security seeds service services shoes shop shopping shops skiing smart social
    software solar songs space sport sports standard star store stores student students studio style
    support surf talk target tax taxi teach team tech technology telegraph theater theatre tickets time
    times tools tour tourism tours toys trade trading train trains training transport travel tribune
    tutorials university used vacation vacations video videos visit voice watch watches water weather
    wedding weddings wiki wine wines women work world yoga
    """.split()
)
"""Labels that name a thing. Those that were seen to belong to strangers in several countries, such as
``target``, ``express``, ``metro``, ``independent`` and ``domain``, and their like."""

SAME: Final = {
    # Shorteners of a brand, and names it has changed or also has.
    "a.co": "amazon.*",
    "amzn.com": "amazon.*",
    "amzn.to": "amazon.*",
    "fb.com": "facebook.*",
    "guardian.co.uk": "theguardian.*",
    "instagr.am": "instagram.*",
    "t.co": "twitter.*",
    "wa.me": "whatsapp.*",
    "x.com": "twitter.*",
    "youtu.be": "youtube.*",
}
"""Websites of a brand that has another label."""

_INSTITUTIONS: Final = frozenset("arpa edu gov int mil museum".split())
_COMMERCIAL: Final = frozenset(
    "biz co com firm gen in info ltd me ne net nom or org plc shop store web".split()
)
_SHORT: Final = 3
_REMEMBERED: Final = 2**19


@lru_cache(_REMEMBERED)
def brand_of(website: str) -> str:
    """The brand that a bare host or a URL belongs to, as one name to compare by. Remembered.

    Returns:
        Such as ``amazon.*``; the website itself, as :func:`~webgym.core.websites.site_of` names it, where
        nothing else can be of its brand.

    Raises:
        ValueError: there is no host.
    """
    site = site_of(website)
    if site in SAME:
        return SAME[site]
    suffix = _suffixes().publicsuffix(site)
    if suffix is None or suffix == site:
        return site
    label = site.removesuffix(f".{suffix}")
    is_known = label in SHORT_BRANDS if len(label) <= _SHORT else label not in THINGS
    return f"{label}.*" if "." not in label and is_known and _is_open(suffix) else site


def brand_or_text(website: str) -> str:
    """As :func:`brand_of`, for comparing: what does not name a website stands for itself."""
    try:
        return brand_of(website)
    except ValueError:
        return website


def _is_open(suffix: str) -> bool:
    """Whether anybody may have a name under it."""
    second, _, top = suffix.rpartition(".")
    return second in _COMMERCIAL if second else top not in _INSTITUTIONS


@cache
def _suffixes() -> PublicSuffixList:
    """What registries say; what stands under another suffix is a customer's."""
    return PublicSuffixList(only_icann=True, accept_unknown=False)
