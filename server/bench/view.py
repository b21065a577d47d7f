"""The bench in a terminal: six traces, the stream's health, what to do now; and without one, a line an event."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self, TextIO

import numpy as np
from numpy.typing import NDArray

from daq.bench.forces import Result
from daq.bench.record import STARTED
from daq.bench.run import BenchRun
from daq.bench.status import BenchStatus
from daq.journal.rows import Event
from server.bench.keys import KEYS, KeyInput
from server.bench.loop import LITTLE_DISK_BYTES
from server.bench.meter import StreamMeter

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

Floats = NDArray[np.float64]

AXES = (("Fx", "N"), ("Fy", "N"), ("Fz", "N"), ("Tx", "N mm"), ("Ty", "N mm"), ("Tz", "N mm"))
# A trace spans at least this, so that noise does not look like a load [N, N mm].
LEAST_SPAN = np.array([0.2, 0.2, 0.2, 4.0, 4.0, 4.0])
NEAR_FULL_SCALE = 0.8
_FINE, _PLAIN = "▁▂▃▄▅▆▇█", "_.-~=+*#"
# The way back from what may have been a slip of the hand.
_WAYS_BACK = {"case_skipped": "repeat {id} goes back to it", "excluded": "include {case} takes it in again"}
_MARKS = {"done": "x", "skipped": "-", "now": ">", "open": " "}


def sparkline(values: Floats, least_span: float, levels: str = _FINE) -> str:
    """Draw values (n,) as a line of n characters."""
    if not len(values):
        return ""
    low, high = float(values.min()), float(values.max())
    middle, span = 0.5 * (low + high), max(high - low, least_span)
    share = (values - (middle - 0.5 * span)) / span
    return "".join(levels[int(k)] for k in np.clip(share * len(levels), 0, len(levels) - 1))


def bar(share: float, width: int = 10) -> str:
    """Draw a share of 1 as a bar, with its number."""
    filled = round(min(max(share, 0.0), 1.0) * width)
    return "#" * filled + "." * (width - filled) + f" {100 * share:3.0f} %"


def line_of(event: Event) -> str:
    """Return one line for an event, for logs and pipes."""
    value = {} if event.kind == STARTED else dict(event.value)
    words = [event.kind.replace("_", " "), *(f"{k} {_brief(v)}" for k, v in value.items())]
    words += [_WAYS_BACK[event.kind].format(**value)] if event.kind in _WAYS_BACK else []
    return f"{event.at_s:9.2f} s  {'; '.join(words)}"


def result_line(result: Result) -> str:
    """Return a measured force with its standard uncertainty, and the prediction where it may be seen."""
    force = " ".join(f"{v:+.3f}" for v in result.force_N)
    text = f"{result.case}: ({force}) N ± {' '.join(f'{v:.3f}' for v in result.sd_N)}"
    if result.predicted_N is not None:
        text += f"; predicted ({' '.join(f'{v:+.2f}' for v in result.predicted_N)}) N"
        text += ", OUTSIDE the band" if result.outside else ""
    return text


def render(
    status: BenchStatus,
    meter: StreamMeter,
    keys: KeyInput | None = None,
    space_left: int | None = None,
    said: str = "",
    results: Sequence[Result] = (),
    levels: str = _FINE,
    width: int = 100,
) -> RenderableType:
    """Draw everything that the user needs to see.

    Args:
        status: of the run.
        meter: of the stream.
        keys: for a question that is being answered.
        space_left: on the disk, in bytes.
        said: what the last key was answered with.
        results: of all cases, shown when the session is closed.
        levels: characters of the traces.
        width: of the terminal.
    """
    from rich.console import Group
    from rich.text import Text

    # What must be seen comes first: a low terminal cuts the end off.
    lines: list[RenderableType] = [Text(status.step, "bold"), Text(f"NOW: {status.todo}", "bold cyan")]
    if keys is not None and keys.question:
        lines.append(Text(f"{keys.question} {keys.typed}_", "bold"))
    elif said:
        lines.append(Text(said, "magenta"))
    lines += [_traces(meter, levels, max(width - 50, 10)), *_health(meter, status, space_left)]
    if status.live is not None:
        lines.append(Text(f"hangs now  {result_line(status.live)}", "red" if status.live.outside else ""))
    if status.last is not None:
        lines.append(Text(f"measured   {result_line(status.last)}"))
    lines += [Text(f"! {text}", "yellow") for text in status.warnings]
    lines += [Text(result_line(r), "red" if r.outside else "") for r in results] if status.closed else []
    lines += [Text(text) for text in _checklist(status)]
    lines.append(Text("  ".join(f"{key} {text}" for key, _, text in KEYS), "dim"))
    return Group(*lines)


class LiveView:
    """Redraws a terminal while the bench runs; use as a context.

    Args:
        run: the bench.
        meter: of its stream.
        keys: for questions.
        console: by default the terminal's.
    """

    def __init__(self, run: BenchRun, meter: StreamMeter, keys: KeyInput, console: Console | None = None) -> None:
        from rich.console import Console
        from rich.live import Live

        _lenient(sys.stdout)
        self._run, self._meter, self._keys = run, meter, keys
        self._console = console or Console(highlight=False, no_color="NO_COLOR" in os.environ)
        self._live = Live(console=self._console, auto_refresh=False, screen=False, transient=False)
        self._levels = _FINE if "utf" in (self._console.encoding or "").lower() else _PLAIN
        self.said = ""

    def tell(self, events: Sequence[Event]) -> None:
        """Clear the last refusal, and say how to come back; the events themselves are seen in the next drawing."""
        if events:
            self.said = " ".join(line_of(event).strip() for event in events if event.kind in _WAYS_BACK)

    def refuse(self, error: Exception) -> None:
        """Show why a key did nothing."""
        self.said = str(error)

    def draw(self, space_left: int | None = None) -> None:
        """Draw anew."""
        status = self._run.status()
        results = self._run.results() if status.closed else ()
        shown = render(
            status, self._meter, self._keys, space_left, self.said, results, self._levels, self._console.width
        )
        self._live.update(shown, refresh=True)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()


class LineView:
    """Prints one line an event.

    Args:
        out: by default standard output.
    """

    def __init__(self, out: TextIO | None = None) -> None:
        self._out = out or sys.stdout
        _lenient(self._out)

    def tell(self, events: Sequence[Event]) -> None:
        """Print what happened."""
        for event in events:
            self._out.write(line_of(event) + "\n")
        self._out.flush()

    def refuse(self, error: Exception) -> None:
        """Print why a line did nothing."""
        self._out.write(f"refused: {error}\n")
        self._out.flush()

    def draw(self, space_left: int | None = None) -> None:
        """Draw nothing: there is nothing to redraw."""


def _lenient(stream: TextIO) -> None:
    """Write what a code page does not know as a question mark: a note must not end a log."""
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors="replace")


def _traces(meter: StreamMeter, levels: str, width: int) -> Table:
    from rich.table import Table
    from rich.text import Text

    out = Table(box=None, show_header=False, padding=(0, 1))
    traces, shares = meter.traces(width), meter.saturation
    for k, (name, unit) in enumerate(AXES):
        value = meter.latest[k]
        number = "-" if np.isnan(value) else f"{value:+9.3f}" if k < 3 else f"{value:+9.1f}"
        share = Text("range not known", "dim")
        if shares is not None and not np.isnan(shares[k]):
            near = shares[k] >= NEAR_FULL_SCALE
            share = Text(bar(float(shares[k])), "bold red" if near else "green")
        out.add_row(name, Text(number, justify="right"), unit, share, sparkline(traces[:, k], LEAST_SPAN[k], levels))
    return out


def _health(meter: StreamMeter, status: BenchStatus, space_left: int | None) -> list[RenderableType]:
    from rich.text import Text

    stream = Text(meter.state, "" if meter.state in ("streaming", "waiting") else "bold red")
    stream.append(f" {meter.why}" if meter.state in ("lost", "not understood") else "", "bold red")
    stream.append("  rate -" if meter.rate_hz is None else f"  rate {meter.rate_hz:.1f} Hz", "not bold")
    stream.append(f"  gaps {meter.gaps} ({meter.lost} lost)", "red" if meter.gaps else "")
    stream.append(f"  overloads {meter.overloads}", "red" if meter.overloads else "")
    stream.append(f"  damaged {meter.damaged}", "red" if meter.damaged else "")
    bench = Text(f"{status.now_s:.1f} s")
    tare = "no tare" if status.tare_age_s is None else f"tare {status.tare_age_s:.0f} s ago"
    bench.append(f"  {tare}", "yellow" if status.tare_age_s is None else "")
    if meter.worst is not None:
        bench.append(f"  most {100 * meter.worst:.0f} % of range", "red" if meter.worst >= NEAR_FULL_SCALE else "")
    if space_left is not None:
        little = space_left < LITTLE_DISK_BYTES
        bench.append(f"  disk {max(space_left, 0) / 1e9:.1f} GB left", "bold red" if little else "")
    return [*([Text(meter.alarm, "bold red")] if meter.alarm else []), stream, bench]


def _checklist(status: BenchStatus, around: int = 3) -> list[str]:
    """Return the steps near the present one, and how many there are."""
    at = next((i for i, (_, _, state) in enumerate(status.checklist) if state == "now"), len(status.checklist) - 1)
    first = max(min(at - around, len(status.checklist) - 2 * around - 1), 0)
    shown = status.checklist[first : first + 2 * around + 1]
    done = sum(state == "done" for _, _, state in status.checklist)
    skipped = sum(state == "skipped" for _, _, state in status.checklist)
    lines = [f"[{_MARKS[state]}] {name}  {text}" for name, text, state in shown]
    return [*lines, f"{done} of {len(status.checklist)} steps done, {skipped} skipped"]


def _brief(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list | tuple):
        return "(" + " ".join(_brief(v) for v in value) + ")"
    if isinstance(value, dict):
        return " ".join(f"{k} {_brief(v)}" for k, v in value.items())
    return str(value)
