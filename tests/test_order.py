"""Which files a run of all tests begins with."""

from __future__ import annotations

from tests.conftest import LONGEST, TESTS


def test_the_files_that_a_run_begins_with_are_there() -> None:
    assert [name for name in LONGEST if not (TESTS / name).is_file()] == []
