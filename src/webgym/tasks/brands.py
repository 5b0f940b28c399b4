"""Websites that belong to one brand: ``amazon.com``, ``amazon.de`` and ``amazon.co.uk``.

Websites are usually compared by registrable domain (:func:`webgym.core.websites.site_of`). For keeping
training and test apart that is too fine: a brand's website looks and works alike in every country. So the
split, the check for leaks and the weights that spread draws over websites compare brands. Counts, duplicates
and the blocklist compare websites: ``amazon.de`` may block an agent where ``amazon.com`` does not.

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

from functools import cache, lru_cache
from typing import Final

from publicsuffixlist import PublicSuffixList

from webgym.core.websites import site_of

SHORT_BRANDS: Final = frozenset(
    "3m abb adp aon axa bbc bmw bp cnn dhl dsw epa ey gap ge h-m hm hp ibm ing jll kfc kia lg mac mtv"
    " nec o2 obi olx pwc qvc sap sas tcl tnt tui ubs ups uss vw wmf".split()
)
"""Labels of up to three characters that one company has in many countries. Longer ones need not be listed."""

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
"""Labels that are common words, which have unrelated owners in several countries: ``target``, ``express``,
``metro``, ``independent``, ``domain`` and the like."""

SAME: Final = {
    # URL shorteners of a brand, and its former or additional names.
    "a.co": "amazon.*",
    "amzn.com": "amazon.*",
    "amzn.eu": "amazon.*",
    "amzn.to": "amazon.*",
    "fb.com": "facebook.*",
    "go.com": "espn.*",  # espn.go.com; also abc.go.com
    "guardian.co.uk": "theguardian.*",
    "instagr.am": "instagram.*",
    "t.co": "twitter.*",
    "wa.me": "whatsapp.*",
    "x.com": "twitter.*",
    "youtu.be": "youtube.*",
}
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
