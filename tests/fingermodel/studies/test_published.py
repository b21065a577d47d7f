"""When a published figure and our own agree."""

from __future__ import annotations

import pytest

from fingermodel.studies.published import row, row_about, row_within


@pytest.mark.parametrize(
    ("published", "ours", "agrees"), [("0.835", 0.8348, True), ("0.835", 0.8343, False), ("32", 31.4, False)]
)
def test_agreement_is_to_the_printed_digits(published: str, ours: float, agrees: bool) -> None:
    assert row("x", published, ours, "1").agrees is agrees


def test_agreement_with_a_range_or_a_spread() -> None:
    assert [row_within("x", "1.5", "2.5", ours, "1").agrees for ours in (1.49, 1.5, 2.5, 2.51)] == [
        False,
        True,
        True,
        False,
    ]
    assert [row_about("x", "2.0", "0.5", ours, "1").agrees for ours in (1.49, 1.6, 2.4, 2.51)] == [
        False,
        True,
        True,
        False,
    ]
