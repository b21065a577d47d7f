"""The way to the service: one exchange at a time, and how long to leave it alone after one that failed."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from daq.errors import InputError
from daq.uplink.wire import retry_after_s

if TYPE_CHECKING:
    import httpx

FIRST_BACK_OFF_S, MOST_BACK_OFF_S = 0.25, 30.0
# How much longer than asked for, at most: benches that were all sent away must not all return at once.
RETRY_JITTER = 0.25
# Long enough for a chunk over a poor line; the sampling thread waits for none of this.
TIMEOUT_S, CONNECT_S = 30.0, 5.0


def open_client(url: str, token: str | None = None, timeout_s: float = TIMEOUT_S) -> httpx.Client:
    """Return a client of a service; nothing is sent yet.

    Args:
        url: of the service, such as http://bench-pc:8000.
        token: that the service gave; None where it asks for none.
        timeout_s: of each pause in an exchange.

    Raises:
        InputError: it is no address.
    """
    import httpx

    address = address_of(url)
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    # A proxy that the environment names leads to the world outside; the service is the lab's own.
    timeout = httpx.Timeout(timeout_s, connect=min(timeout_s, CONNECT_S))
    return httpx.Client(base_url=address, headers=headers, timeout=timeout, trust_env=False)


def address_of(url: str) -> httpx.URL:
    """Return the address of a service.

    Raises:
        InputError: it is no address.
    """
    import httpx

    expected = "one such as http://bench-pc:8000"
    try:
        address = httpx.URL(url.rstrip("/"))
    except httpx.InvalidURL as error:
        raise InputError(f"the address {url!r} of the service ({error})", expected) from error
    if address.scheme not in ("http", "https") or not address.host:
        raise InputError(f"the address {url!r} of the service", expected)
    return address


class Link:
    """Asks the service, and keeps away from it for as long as it wants.

    Args:
        client: of the service.
        clock: monotonic seconds.
        wall: wall-clock seconds, for dates in the service's answers only.
        chance: of 0 to 1.
    """

    def __init__(
        self,
        client: httpx.Client,
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
        chance: Callable[[], float] = random.random,
    ) -> None:
        self._client = client
        self._clock, self._wall, self._chance = clock, wall, chance
        self._not_before_s = -float("inf")
        self._failures = 0
        self.problem: str | None = None

    def wait_s(self) -> float:
        """Return how long the service is to be left alone [s]."""
        return max(self._not_before_s - self._clock(), 0.0)

    def exchange(
        self, method: str, path: str, body: bytes = b"", headers: Mapping[str, str] | None = None
    ) -> httpx.Response | None:
        """Ask; return a success or a refusal (4xx), or None where the same is to be asked again later."""
        import httpx

        try:
            response = self._client.request(method, path, content=body, headers=dict(headers or {}))
        except (httpx.HTTPError, OSError) as error:
            self.back_off(f"no answer ({str(error) or type(error).__name__})")
            return None
        status = response.status_code
        if status in (429, 503):
            self.back_off(said(response), retry_after_s(response.headers, self._wall()))
        elif status in (408, 425) or not (200 <= status < 300 or 400 <= status < 500):
            # A redirection too: what answers so is not the service, but something on the way to it.
            self.back_off(said(response))
        else:
            return response
        return None

    def back_off(self, problem: str, asked_s: float | None = None) -> None:
        """Keep away: as long as was asked for and a little longer, or ever longer, up to 30 s.

        Args:
            problem: to be shown.
            asked_s: by the service; None where it did not say.
        """
        self.problem = problem
        if asked_s is None:
            longest_s = min(FIRST_BACK_OFF_S * 2.0 ** min(self._failures, 16), MOST_BACK_OFF_S)
            wait_s = longest_s * (0.5 + 0.5 * self._chance())
        else:
            wait_s = asked_s + max(asked_s, FIRST_BACK_OFF_S) * RETRY_JITTER * self._chance()
        self._failures += 1
        self._not_before_s = self._clock() + wait_s

    def works(self) -> None:
        """Note that the service did what it was asked for."""
        self._failures, self.problem = 0, None

    def close(self) -> None:
        """Hang up."""
        self._client.close()


def answered(response: httpx.Response) -> Any:
    """Return the JSON of an answer; None where it is none."""
    with suppress(ValueError):
        return response.json()
    return None


def said(response: httpx.Response) -> str:
    """Describe an answer in one short line."""
    body = answered(response)
    text = ""
    if isinstance(body, Mapping):
        text = str(body.get("detail") or body.get("title") or "")
    return " ".join(f"the service says {response.status_code} {text[:200]}".split())
