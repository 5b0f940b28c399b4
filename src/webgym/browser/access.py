"""What an identity lets one tab pass: websites that ask for a password, certificates that are not checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from webgym.browser.cdp import Session
from webgym.browser.cdp_messages import AuthRequired, CertificateError, RequestPaused
from webgym.core.identity import Identity


class Access:
    """Answers what one tab is asked for.

    Args:
        session: the tab's session.
        identity: the browser's.
        credentials: ``NAME:PASSWORD`` by origin.
        on_untrusted: called with the address and the error of a certificate that is refused.
    """

    def __init__(
        self,
        session: Session,
        identity: Identity,
        credentials: dict[str, str],
        on_untrusted: Callable[[str, str], None],
    ) -> None:
        self.credentials = credentials
        self._on_untrusted = on_untrusted
        self._session = session
        self._hosts = identity.ignore_tls_errors
        self._answered: set[str] = set()
        """Requests that got the credentials; who asks again does not take them."""
        session.on("Security.certificateError", CertificateError, self._on_certificate)
        session.on("Fetch.authRequired", AuthRequired, self._on_asked)
        session.on("Fetch.requestPaused", RequestPaused, self._on_paused)

    @property
    def commands(self) -> list[tuple[str, dict[str, Any]]]:
        """The commands that make the tab ask about certificates."""
        checking = [("Security.enable", {}), ("Security.setOverrideCertificateErrors", {"override": True})]
        return checking if self._hosts else []

    @property
    def patterns(self) -> list[dict[str, Any]]:
        """The requests that have to be paused, as Chromium asks for credentials only of those."""
        return [{"urlPattern": f"{origin}/*"} for origin in self.credentials]

    def signs_in(self, url: str) -> bool:
        """Whether the origin of this URL has credentials."""
        return any(url.startswith(f"{origin}/") for origin in self.credentials)

    def _on_paused(self, paused: RequestPaused) -> None:
        if not paused.is_response and self.signs_in(paused.request.url):
            self._session.send("Fetch.continueRequest", {"requestId": paused.request_id})

    def _on_asked(self, asked: AuthRequired) -> None:
        given = self.credentials.get(asked.auth_challenge.origin)
        answer: dict[str, str] = {"response": "Default"}
        if given is not None and asked.auth_challenge.source == "Server":
            name, _, password = given.partition(":")
            answer = {"response": "ProvideCredentials", "username": name, "password": password}
            if asked.request_id in self._answered:
                answer = {"response": "CancelAuth"}
            self._answered.add(asked.request_id)
        answered = {"requestId": asked.request_id, "authChallengeResponse": answer}
        self._session.send("Fetch.continueWithAuth", answered)

    def _on_certificate(self, error: CertificateError) -> None:
        host = urlsplit(error.request_url).hostname or ""
        parents = {f".{host}", *(host[place:] for place, letter in enumerate(host) if letter == ".")}
        is_allowed = host in self._hosts or bool(parents & set(self._hosts))
        action = "continue" if is_allowed else "cancel"
        if not is_allowed:
            self._on_untrusted(error.request_url, error.error_type)
        self._session.send("Security.handleCertificateError", {"eventId": error.event_id, "action": action})
