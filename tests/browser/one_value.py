"""Every number that the pages show more than once, gathered page by page."""

from __future__ import annotations

import re
from collections import defaultdict
from typing import Any

from tests.browser.pages import Watched

# Rows of the tables under a heading, each a dictionary by column title; the first column's is "first".
_TABLES = """(heading) => [...document.querySelectorAll('h2, h3')].filter((h) => h.textContent.trim() === heading)
  .flatMap((h) => [...h.closest('section').querySelectorAll('table')]).flatMap((table) => {
    const titles = [...table.querySelectorAll('thead th, thead td')].map((c) => c.textContent.trim());
    return [...table.querySelectorAll('tbody tr')].map((row) => Object.fromEntries(
      [...row.cells].map((c, i) => [i ? titles[i] : 'first', c.textContent.trim()])));
  })"""
_PLACES = {"identification", "validation"}
Key = tuple[str, ...]


class Shown:
    """Numbers by what they are, each with the page that shows it.

    Args:
        seen: the page.
        session: whose pages are walked.
    """

    def __init__(self, seen: Watched, session: str) -> None:
        self.seen, self.session = seen, session
        self.numbers: dict[Key, list[tuple[str, str]]] = defaultdict(list)

    def note(self, key: Key, text: str, page: str) -> None:
        """Take down a number, as it is written."""
        self.numbers[key].append((text.replace("\N{MINUS SIGN}", "-"), page))

    def rows(self, heading: str) -> list[dict[str, str]]:
        """Rows of the tables under a heading."""
        found: list[dict[str, str]] = self.seen.page.evaluate(_TABLES, heading)
        assert found, heading
        return found

    def errors(self, heading: str, columns: dict[str, str], page: str) -> None:
        """Take down RMSE by role and mount, of the models that columns stand for."""
        for row in self.rows(heading):
            role, place = [*re.split(r", | at the |/", row["first"]), ""][:2]
            for title, model in columns.items():
                if role in _PLACES and title in row:
                    self.note(("RMSE", model, role, place), row[title], page)

    def first(self, key: Key, pattern: str, text: str, page: str) -> None:
        """Take down the first group of a pattern."""
        found = re.search(pattern, text)
        assert found is not None, (pattern, page)
        self.note(key, found[1], page)

    def differing(self) -> list[str]:
        """What is shown with more than one value, beyond rounding."""
        out = []
        for key, shown in self.numbers.items():
            for text, page in shown[1:]:
                least = min(_digits(text), _digits(shown[0][0]))
                if abs(float(text) - float(shown[0][0])) > 1.001 * 0.5 * 10.0**-least + 0.5 * 10.0 ** -_most(
                    text, shown
                ):
                    out.append(f"{' '.join(key)}: {shown[0][0]} ({shown[0][1]}), {text} ({page})")
        return out

    def walk(self, job: str, revision: str, effect: str, parameter: str, case: str) -> None:
        """Open every page that shows numbers of the session and take them down.

        Args:
            job: of the search.
            revision: with the effect.
            effect: that was found.
            parameter: of it.
            case: that is looked at closely.
        """
        seen, session = self.seen, self.session
        home = f"sessions/{session}"
        models = {"own": "", "revision": revision, "nothing": f"{job}/nothing", "effect": f"{job}/{effect}"}
        for model, name in models.items():
            asked = f"?case={case}" + (f"&model={name}" if name else "")
            seen.open(f"{home}/compare{asked}", f"{session}: predicted against measured")
            seen.drawn(2)
            self.errors("Errors", {"RMSE [N]": model}, f"compare {model}")
            z = next(r["z"] for r in self.rows("Load cases") if r["first"] == case)
            self.note(("z", model, case), z, f"compare {model}, table")
            panel = seen.page.locator("#case").inner_text()
            self.first(("z", model, case), r"; z (\d+\.\d+)", panel, f"compare {model}, case")
            seen.page.goto("about:blank")
        seen.open(f"{home}/find", f"{session}: find the missing effect")
        seen.drawn()
        self.errors("Error before and after", {"RMSE before [N]": "nothing", "after [N]": "effect"}, "find")
        self.first((parameter,), rf"{parameter} = (\d+\.\d+)", seen.text(), "find, verdict")
        best = self.rows("Explanations")
        self.first((parameter,), rf"{parameter} (\d+\.\d+)", best[0]["value"], "find, explanations")
        self.first(("acts",), r"Probability (?:> )?(\d+) %", seen.text(), "find, verdict")
        acts = next(r["acts by its name"] for r in best if r["first"] == effect and "acts by its name" in r)
        self.first(("acts",), r"(\d+) %", acts, "find, explanations")
        for fit, model in (("before", "nothing"), ("after", "effect")):
            self.cell(fit, model)
        seen.open(f"{home}/effect?name={effect}&job={job}", effect)
        seen.drawn(2)
        self.first((parameter,), rf"{parameter} = (\d+\.\d+)", seen.text(), "effect")
        titles = seen.page.evaluate("document.querySelector('.js-plotly-plot').layout.title.subtitle.text")
        self.first((parameter,), rf"{parameter} = (\d+\.\d+)", titles, "effect, figure")
        self.first(("acts",), r"whatever else does: (?:> )?(\d+) %", seen.text(), "effect")
        changed = seen.page.evaluate("document.querySelector('.js-plotly-plot').layout.meta.case")
        assert f"It changes case {changed} most" in seen.text()
        seen.open(f"{home}/fall", f"{session}: the fall of the error")
        seen.drawn(2)
        steps = {next(t for t in self.rows("The step")[0] if t.startswith("RMSE with")): "own"}
        steps[f"with {revision} [N]"] = "revision"
        self.errors("The step", steps, "fall, the step")
        for row in self.rows("All steps"):
            # The refit alone, which is no revision, is of another fit than those of the search.
            if row["first"] == "refit alone":
                continue
            model = "revision" if row["first"] == revision else "own"
            for title, text in row.items():
                role, _, place = title.removesuffix(" [N]").partition(", ")
                if role in _PLACES:
                    self.note(("RMSE", model, role, place), text, "fall, all steps")
        seen.open(f"{home}/report?job={job}&model={revision}", f"{session}: report")
        seen.page.get_by_text("Ready. The browser's own dialogue").wait_for()
        seen.page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
        for row in self.rows("Error before and after"):
            role, _, place = row["first"].partition(", ")
            for text, model in zip(row["RMSE [N]"].split(" → "), ("nothing", "effect"), strict=True):
                self.note(("RMSE", model, role, place), text, "report, first page")
        self.errors("Summary", {"RMSE [N]": "revision"}, "report, summary")
        shown = next(r for r in self.rows("Load cases") if r["first"].startswith(case))
        self.note(("z", "revision", case), shown["z"], "report, load cases")
        self.first((parameter,), rf"the readings say {parameter} = (\d+\.\d+)", seen.text(), "report")
        assert f"{changed}, identification" in seen.text() or f"{changed}, validation" in seen.text()

    def cell(self, fit: str, model: str) -> None:
        """Click a cell of the map, and take down its number and what the cases say that it leads to."""
        from tests.browser.pages import click_point

        page, home = self.seen.page, f"sessions/{self.session}"
        self.seen.open(f"{home}/find", f"{self.session}: find the missing effect")
        self.seen.drawn()
        page.get_by_label("Residuals after a refit").select_option(fit)
        page.wait_for_timeout(100)
        self.seen.drawn()
        text = page.evaluate("document.querySelector('.js-plotly-plot').data[0].text[0][0]")
        self.note(("cell", model), text, f"map {fit}")
        click_point(page, 0, [0, 0])
        page.get_by_role("heading", name=f"{self.session}: predicted against measured").wait_for()
        page.get_by_text("load cases of that point or cell").wait_for()
        caption = page.get_by_text(re.compile("root mean square")).first.inner_text()
        self.first(("cell", model), r"root mean square (\d+\.\d+)", caption, f"compare from the map {fit}")
        found: Any = [float(r["z"]) for r in self.rows("Load cases")]
        rms = (sum(z * z for z in found) / len(found)) ** 0.5
        self.note(("cell", model), f"{rms:.2f}", f"z of the cases from the map {fit}")


def _digits(text: str) -> int:
    return len(text.partition(".")[2])


def _most(text: str, shown: list[tuple[str, str]]) -> int:
    return max(_digits(text), _digits(shown[0][0]))
