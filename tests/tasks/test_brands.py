"""Websites that one brand has in several countries are one; strangers with a common name are not."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from webgym.core.websites import site_of
from webgym.tasks.brands import SAME, SHORT_BRANDS, THINGS, brand_of, brand_or_text


@pytest.mark.parametrize(
    "websites",
    [
        ("amazon.com", "https://www.amazon.de/gp", "amazon.co.uk", "smile.amazon.com", "amazon.com.br"),
        ("amazon.com", "amzn.to", "amzn.eu"),
        ("espn.com", "espn.go.com"),
        ("ikea.com", "ikea.es"),
        ("bbc.com", "bbc.co.uk", "news.bbc.co.uk"),
        ("craigslist.org", "craigslist.ca", "craigslist.co.jp"),
        ("twitter.com", "x.com"),
        ("theguardian.com", "guardian.co.uk"),
        ("rakuten.ne.jp", "rakuten.com"),
        ("openai.com", "openai.org"),
    ],
)
def test_a_brand_is_one_across_suffixes(websites: tuple[str, ...]) -> None:
    assert len({brand_of(website) for website in websites}) == 1


@pytest.mark.parametrize(
    "websites",
    [
        ("abc.com", "abc.net.au", "abc.net", "abc.es"),
        ("go.com", "go.jp", "meti.go.jp"),
        ("health.gov.uk", "health.gov.au", "health.gov", "health.com"),
        ("cambridge.ac.uk", "cambridge.edu", "cambridge.org"),
        ("alice.github.io", "alice.gitlab.io", "alice.com", "alice.blogspot.com"),
        ("amazon.com", "amazon.uk.com", "amazon.s3.amazonaws.com"),  # suffixes that somebody rents out
        ("news.com.au", "news.de"),
        ("target.com", "target.com.au"),
        ("lincoln.k12.or.us", "lincoln.k12.ca.us", "lincoln.com"),
        ("library.tokyo.jp", "library.com"),
        ("fernhill-books.webgym.test", "fernhill-books.com", "corner-books.webgym.test"),
        ("10.0.0.7", "10.0.0.8", "localhost", "[::1]", "co.uk", "com"),
        ("first.example", "first.test"),
    ],
)
def test_strangers_stay_apart(websites: tuple[str, ...]) -> None:
    assert len({brand_of(website) for website in websites}) == len(websites)


def test_the_lists_hold_what_the_rule_looks_up() -> None:
    assert all(label == label.lower() and "." not in label for label in SHORT_BRANDS | THINGS)
    assert all(site_of(site) == site and brand.endswith(".*") for site, brand in SAME.items())
    for brand in SAME.values():
        assert brand_of(brand.replace("*", "com")) == brand


@given(st.from_regex(r"[a-z0-9-]{1,12}(\.[a-z0-9-]{1,8}){0,3}", fullmatch=True))
def test_whoever_shares_a_website_shares_a_brand(host: str) -> None:
    try:
        site = site_of(host)
    except ValueError:
        assert brand_or_text(host) == host
        return
    assert brand_of(host) == brand_of(site) == brand_of(f"https://{host}/path")
