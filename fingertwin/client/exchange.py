"""Requests and their answers: errors in one line, repeats where a repeat does no harm, pages put together."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any
from urllib.parse import quote

import httpx

from daq.errors import InputError, require_list
from daq.uplink.wire import API, retry_after_s
from fingertwin.client.errors import ServiceError, ServiceUnreachableError

Body = dict[str, Any]

# Between repeats [s]; what the service asks for counts more, up to the longest that a program waits unasked.
FIRST_BACK_OFF_S, MOST_BACK_OFF_S, MOST_ASKED_S = 0.25, 8.0, 60.0
RETRY_JITTER = 0.25
_CONNECT_S = 5.0
# Too much at once, or something on the way to the service, or the service as it stops.
AWAY = (429, 502, 503, 504)
_PAGE = 200


class Exchange:
    """Asks one service.

    Args:
        url: of the service, such as http://127.0.0.1:8765.
        token: that it gave; None where it asks for none.
        timeout_s: of each pause in an exchange.
        retries: how often a request that changes nothing when it comes twice is repeated.
        transport: instead of the network.
        sleep: waits so many seconds.

    Raises:
        InputError: it is no address, or no token.
    """

    def __init__(
        self,
        url: str,
        token: str | None = None,
        timeout_s: float = 30.0,
        retries: int = 3,
        transport: httpx.BaseTransport | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        address = _address(url)
        self.url, self.sleep = str(address).rstrip("/"), sleep
        self.headers = {} if token is None else {"Authorization": f"Bearer {_token(token)}"}
        self._retries, self._timeout_s = retries, timeout_s
        timeout = httpx.Timeout(timeout_s, connect=min(timeout_s, _CONNECT_S))
        # A proxy that the environment names leads to the world outside; the service is the lab's own.
        self._client = httpx.Client(
            base_url=address, headers=self.headers, timeout=timeout, transport=transport, trust_env=False
        )

    def get(self, path: str, params: Mapping[str, Any] | None = None) -> Body:
        """Read."""
        return self.body(self.ask("GET", path, params=params, again=True))

    def post(self, path: str, value: Mapping[str, Any], *, again: bool = False) -> Body:
        """Send; `again` where the very same twice does no harm."""
        return self.body(self.ask("POST", path, json=value, again=again))

    def put(self, path: str, content: bytes, headers: Mapping[str, str]) -> Body:
        """Store what may be stored twice."""
        return self.body(self.ask("PUT", path, content=content, headers=headers, again=True))

    def pages(self, path: str, key: str, params: Mapping[str, Any] | None = None) -> Iterator[Body]:
        """Yield the rows of a list, page after page."""
        query = {k: v for k, v in (params or {}).items() if v is not None} | {"limit": _PAGE}
        while True:
            page = self.get(path, query)
            with reading(f"a list of {key}"):
                rows, after = page[key], page.get("next")
            yield from rows
            if after is None:
                return
            query["after"] = after

    def ask(self, method: str, path: str, *, again: bool, **request: Any) -> httpx.Response:
        """Ask, again where that helps, and return a success.

        Raises:
            ServiceError: the service refused.
            ServiceUnreachableError: nobody answers.
        """
        request = {k: v for k, v in request.items() if v is not None}
        for attempt in range(self._retries + 1):
            last = not again or attempt == self._retries
            wait_s = min(FIRST_BACK_OFF_S * 2.0**attempt, MOST_BACK_OFF_S) * (1.0 - 0.5 * random.random())  # noqa: S311
            try:
                response = self._client.request(method, path, **request)
            except httpx.RequestError as error:
                if last:
                    raise self._unreachable(error) from error
            else:
                if response.is_success:
                    return response
                asked_s = retry_after_s(response.headers, time.time())
                if last or response.status_code not in AWAY or (asked_s or 0.0) > MOST_ASKED_S:
                    raise ServiceError.of_answer(response)
                if asked_s is not None:
                    wait_s = asked_s + max(asked_s, FIRST_BACK_OFF_S) * RETRY_JITTER * random.random()  # noqa: S311
            self.sleep(wait_s)
        raise AssertionError  # the last attempt returned or raised

    def body(self, response: httpx.Response) -> Body:
        """Return the JSON object of an answer.

        Raises:
            ServiceError: it is none: a login page, say, on the way to the service.
        """
        try:
            value = response.json()
        except ValueError:
            value = None
        if not isinstance(value, dict):
            kind = response.headers.get("Content-Type", "nothing").split(";")[0]
            raise ServiceError(
                response.status_code, f"{self.url} answers {kind}", "JSON of the model service", "Correct the address"
            )
        return value

    def close(self) -> None:
        """Hang up."""
        self._client.close()

    def _unreachable(self, error: httpx.RequestError) -> ServiceUnreachableError:
        if isinstance(error, httpx.TimeoutException) and not isinstance(error, httpx.ConnectTimeout):
            return ServiceUnreachableError(
                f"{self.url} did not answer within {self._timeout_s:g} s", "an answer", "Give a longer timeout_s"
            )
        return ServiceUnreachableError.of(self.url, error)


@contextmanager
def reading(what: str) -> Iterator[None]:
    """Say in one line that an answer does not hold what it should.

    Raises:
        ServiceError: it does not.
    """
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, InputError):
            raise
        lack = f"lacks {error}" if isinstance(error, KeyError) else f"cannot be read ({error})"
        raise ServiceError(
            200,
            f"the service's answer ({what}) {lack}",
            "that of this version",
            "Use client and service of one version",
        ) from error


def listed(values: Sequence[str], what: str) -> list[str]:
    """Return names as a list.

    Raises:
        InputError: it is one name.
    """
    require_list(values, what, "a list of names")
    return list(values)


def path_of(*parts: str) -> str:
    """Return an address below the service's.

    Raises:
        InputError: a part is empty.
    """
    for part in parts:
        if part in ("", ".", ".."):
            raise InputError(f"the name {part!r}", "an id that the service knows")
    return "/".join((API, *(quote(part, safe="") for part in parts)))


def _address(url: str) -> httpx.URL:
    expected = "one such as http://127.0.0.1:8765"
    try:
        address = httpx.URL(url.strip().rstrip("/"))
    except httpx.InvalidURL as error:
        raise InputError(f"the address {url!r} of the service ({error})", expected) from error
    if address.scheme not in ("http", "https") or not address.host:
        raise InputError(f"the address {url!r} of the service", expected)
    return address


def _token(token: str) -> str:
    text = token.strip()
    if not text or not text.isascii() or not text.isprintable() or " " in text:
        # What was given instead may be a secret too, so it is not shown.
        raise InputError(
            "a token with other characters than letters, digits and _", "ft_…, as `fingertwin token` gave it"
        )
    return text
