"""What the documents say that the code knows: counts of the catalogue, links between files, names of modules."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest
from typer.main import get_command

from fingermodel.effects.catalogue import CATALOGUE
from server.cli import app

ROOT = Path(__file__).parents[2]
GUIDES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "data/README.md"])
# Of an effect's numbers these are what was measured once, with the catalogue as it was then.
COUNT = re.compile(r"catalogue of (\d+)|(\d+) (?:built-in )?effects of the catalogue|the catalogue's (\d+) effects")
LINK = re.compile(r"\]\((?!https?:|mailto:|#)([^)#\s]+)(?:#[^)]*)?\)")
IMPORT = re.compile(r"^\s*(?:>>> )?from ((?:daq|fingermodel|server|fingertwin)[\w.]*) import (\w+)", re.MULTILINE)


@pytest.mark.parametrize("guide", GUIDES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_a_guide_is_true_of_the_code(guide: Path) -> None:
    text = guide.read_text("utf-8")
    counts = {int(number) for found in COUNT.findall(text) for number in found if number}
    assert counts <= {len(CATALOGUE)}
    broken = [link for link in LINK.findall(text) if not (guide.parent / link).exists()]
    assert broken == []
    for module, name in IMPORT.findall(text):
        assert importlib.util.find_spec(module) is not None, module
        loaded = importlib.import_module(module)
        assert hasattr(loaded, name) or importlib.util.find_spec(f"{module}.{name}"), f"{module}.{name}"


def test_users_open_sessions_by_the_public_api() -> None:
    imports = [(guide.name, module) for guide in GUIDES for module, _ in IMPORT.findall(guide.read_text("utf-8"))]
    assert [(name, module) for name, module in imports if module.startswith("server")] == []


@pytest.mark.parametrize("guide", ["docs/architecture.md", "CONTRIBUTING.md"])
def test_files_that_a_developer_is_sent_to_are_there(guide: str) -> None:
    text = (ROOT / guide).read_text("utf-8")
    named = set(re.findall(r"`((?:daq|fingermodel|server|fingertwin|tests|data|docs)/[\w./-]*)`", text))
    assert len(named) > 10
    assert [path for path in sorted(named) if "NAME" not in path and not (ROOT / path).exists()] == []


def test_every_command_is_in_the_readme() -> None:
    table = (ROOT / "README.md").read_text("utf-8").partition("## Commands")[2].partition("\n## ")[0]
    named = set(re.findall(r"`(?:fingertwin )?([a-z-]+)", table))
    commands = get_command(app).commands  # type: ignore[attr-defined]
    assert len(commands) > 20
    assert [name for name in commands if name not in named] == []


@pytest.mark.parametrize(
    "word",
    [
        "friction factor", "setting", "mounting", "setup", "protocol", "stand-in", "blind", "superposition limit",
        "in force", "closure", "fault of the session", "curve", "law", "left-out gain",
    ],
)  # fmt: skip
def test_a_word_of_the_answers_and_pages_has_an_entry_in_the_glossary(word: str) -> None:
    entries = re.findall(r"^### (.+)$", (ROOT / "docs/glossary.md").read_text("utf-8"), re.MULTILINE)
    assert any(re.search(rf"\b{word}\b", entry.lower()) for entry in entries)


@pytest.mark.parametrize("page", sorted((ROOT / "docs/reference").glob("*.md")), ids=lambda p: p.name)
def test_what_a_source_page_links_to_has_its_place_in_the_reference(page: Path) -> None:
    """Sphinx links the source of each object to its anchor, which an object outside the index has not."""
    assert ":no-index:" not in page.read_text("utf-8")
