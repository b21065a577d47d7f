"""`fingertwin plot`: what is in a recording, before anybody has said what is what."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from daq.errors import InputError
from daq.files import replacing
from daq.lab.traces import Traces, as_recording, read_traces
from daq.quoting import quoted
from server.application.exporting import writing
from server.commands.console import answer, progress, say, table
from server.figures.plot import Plot
from server.figures.report import Section, write_report
from server.figures.traces import traces_figure

_ENDINGS = (".html", ".png", ".svg")


def plot_recording(recording: Path, out: Path | None, json: str | None) -> None:
    """Draw a recording's channels over time, and list its plateaus.

    Raises:
        InputError: it is no recording, or the figure's name has another ending.
    """
    target = out or Path(f"{recording.name}.html")
    if out is not None and target.suffix.lower() not in _ENDINGS:
        raise InputError(f"--out {target.name}", f"a name that ends in {', '.join(_ENDINGS)}")
    with progress("Reading"), as_recording(recording) as file:
        traces = read_traces(file)
    with progress("Drawing"), writing(target):
        _draw(target, traces, recording.name)
    channels = [{"name": n, "unit": u or None} for n, u in zip(traces.names, traces.units, strict=True)]
    body: dict[str, Any] = {"recording": str(recording), "figure": str(target), "readings": traces.readings}
    body |= {"channels": channels, "time_unit": traces.unit, "plateaus": traces.plateaus, "notes": list(traces.notes)}
    if answer("plot", body, json):
        return
    rows = [
        [c["name"], c["unit"] or "?", f"{low:.4g}", f"{high:.4g}"]
        for c, low, high in zip(channels, traces.lows, traces.highs, strict=True)
    ]
    table(f"{recording.name}: {traces.readings} readings", ["channel", "unit", "least", "greatest"], rows)
    for note in traces.notes:
        say(f"  {note}")
    plateaus = traces.plateaus
    said = f"{len(plateaus)} plateaus" + (f", the first {plateaus[0][0]:g} to {plateaus[0][1]:g}" if plateaus else "")
    say(f"{said} ({traces.unit}): {target}   (fingertwin new {quoted(recording)} --out DIR makes a session of it)")


def _draw(target: Path, traces: Traces, name: str) -> None:
    from server.figures.static import render

    figure = traces_figure(traces, name)
    ending = target.suffix.lower()
    if ending == ".html":
        write_report(target, [Section("Traces", [Plot("traces", "", figure)])], name, static=False)
        return
    with replacing(target) as temporary:
        temporary.write_bytes(render(figure, ending.removeprefix(".")))
