"""What the tests of the pages share."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.browser.pages import Watched, browsing, watched


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser for the tests of a module."""
    with browsing() as found:
        yield found


@pytest.fixture
def seen(browser: Any, url: str) -> Iterator[Watched]:
    """A page of the module's service, which in the end has complained of nothing and asked nobody else."""
    out = watched(browser, url)
    yield out
    out.page.close()
    assert out.complaints == []
    assert out.elsewhere == []
