"""Which website a URL belongs to."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from webgym.core.websites import host_of, site_of, start_url_problem


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
        ("straße-shop.example", "xn--strae-shop-83a.example"),
        ("https://STRAẞE-Shop.example/", "xn--strae-shop-83a.example"),
        ("XN--STRAE-SHOP-83A.example", "xn--strae-shop-83a.example"),
        ("https://stra%C3%9Fe-shop.example/", "xn--strae-shop-83a.example"),
        ("http://2130706433/", "127.0.0.1"),
        ("http://0x7f.0.0.1:80", "127.0.0.1"),
        ("0x7F000001", "127.0.0.1"),
        ("0177.0.0.1", "127.0.0.1"),
        ("127.1", "127.0.0.1"),
        ("http://[::ffff:127.0.0.1]/", "127.0.0.1"),
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


@pytest.mark.parametrize(
    "website", ["", "   ", "https://", "a b.com", "http://[zz]/", "-.-/.", "ex..com", "256.1.1.1", "shop.7"]
)
def test_what_names_no_website_says_so(website: str) -> None:
    with pytest.raises(ValueError, match="does not name a website"):
        host_of(website)


@pytest.mark.parametrize(
    "website",
    """__SHOPPING_ADMIN__ __SHOP__/admin N/A none TODO <website> https//example.org http//:example.org
    https://__REDDIT__/ shop:7770 example http://intranet/ https://example.org:99999/ http://10.0.0.7:70000
    http://[::1]:65536/ https://example.org:80a/ http://1.2.3.400/""".split(),
)
def test_a_placeholder_is_no_website(website: str) -> None:
    assert start_url_problem(website).endswith("does not name a website")


@pytest.mark.parametrize(
    "website",
    """example.org https://example.org:65535/x http://user:word@example.org:80/ localhost localhost:3000
    http://localhost/ http://shop:7770/ 127.0.0.1:8000 http://[::1]:80/ https://example.org/?next=http://x:99999/
    https://bücher.example/ shop.webgym.test""".split(),
)
def test_an_address_is_one(website: str) -> None:
    assert start_url_problem(website) == ""


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
