"""Which website a URL belongs to."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from webgym.core.websites import host_of, site_of


@pytest.mark.parametrize(
    ("website", "host"),
    [
        ("example.com", "example.com"),
        ("https://www.Example.com:443/a/b?c=d#e", "example.com"),
        ("HTTP://user:word@example.com.", "example.com"),
        ("  www.example.com\r\n", "example.com"),
        ("www.com", "www.com"),
        ("www.www.example.org", "example.org"),
        ("example.com?next=https://other.org/", "example.com"),
        ("https://bücher.example/", "xn--bcher-kva.example"),
        ("http://127.0.0.1:8000/x", "127.0.0.1"),
        ("http://[::1]:80/", "[::1]"),
        ("localhost:3000", "localhost"),
    ],
)
def test_the_host_of_every_form(website: str, host: str) -> None:
    assert host_of(website) == host


@pytest.mark.parametrize(
    ("website", "site"),
    [
        ("https://shop.example.co.uk/basket", "example.co.uk"),
        ("m.example.com", "example.com"),
        ("alice.github.io", "alice.github.io"),
        ("https://docs.alice.github.io", "alice.github.io"),
        ("fernhill-books.webgym.test", "fernhill-books.webgym.test"),
        ("http://m.fernhill-books.webgym.test/x", "fernhill-books.webgym.test"),
        ("co.uk", "co.uk"),
        ("localhost", "localhost"),
        ("10.0.0.7", "10.0.0.7"),
        ("http://[::1]/", "[::1]"),
    ],
)
def test_the_registrable_domain_decides(website: str, site: str) -> None:
    assert site_of(website) == site


@pytest.mark.parametrize("website", ["", "   ", "https://", "a b.com", "http://[zz]/", "-.-/.", "ex..com"])
def test_what_names_no_website_says_so(website: str) -> None:
    with pytest.raises(ValueError, match="does not name a website"):
        host_of(website)


@given(st.text(max_size=80))
def test_any_text_gives_a_stable_site_or_a_value_error(text: str) -> None:
    try:
        site = site_of(text)
    except ValueError:
        return
    assert site_of(site) == site
    assert (
        site_of(f"https://www.{site}/path") == site
        or site.startswith("[")
        or site[-1].isdigit()
        or "." not in site
    )
