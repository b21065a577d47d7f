"""What writes to a disk while it fails, is mended and loses power: what every such state machine does alike."""

from __future__ import annotations

import random
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import ClassVar

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from tests.daq.faulty_disk import Disk, faulty


class OnFailingDisk(RuleBasedStateMachine):
    """Lives in one folder after another, each what a power cut has left of the one before.

    Attributes:
        tally: what came to pass in all runs together, for a benchmark; each machine has its own.
        refusal: what may come instead of an acknowledgement.
        attempts: of what is numbered, acknowledged or not.
    """

    tally: ClassVar[Counter[str]]
    refusal: ClassVar[type[Exception]]

    def __init__(self) -> None:
        super().__init__()
        self.held, self.taken = ExitStack(), ExitStack()
        self.folder = Path(self.held.enter_context(tempfile.TemporaryDirectory()))
        self.lives = self.attempts = 0

    def open(self) -> None:
        """Open what is on the disk."""
        raise NotImplementedError

    def close(self) -> None:
        """Close it."""
        raise NotImplementedError

    def reopen(self) -> None:
        """Close and open it, and see that it is the same; the disk works then."""
        raise NotImplementedError

    def same(self) -> None:
        """See that all that was acknowledged is there, with nothing else but what was asked for and not refused."""
        raise NotImplementedError

    def look_at(self, home: Path) -> None:
        """Look at what a power cut has left, before anybody writes on."""

    def first_home(self) -> Path:
        """Make the folder of the first life."""
        home = self.folder / "0"
        home.mkdir()
        return home

    def live_in(self, home: Path) -> None:
        """Go on with the files of a folder, on a disk that works."""
        self.disk = Disk(home)
        self.taken.enter_context(faulty(self.disk))
        self.open()

    def tried(self, do: Callable[[], object]) -> bool:
        """Whether something is acknowledged; only the refusal may come instead."""
        try:
            do()
        except self.refusal:
            return False
        return True

    def spoil(self, fault: tuple[str, int], after: int, short: float) -> None:
        """Let an operation fail from some use on."""
        self.disk.fails, self.disk.code = fault
        self.disk.after, self.disk.short = after, short

    @rule()
    def mend(self) -> None:
        self.disk.mend()

    @rule(draw=st.randoms(use_true_random=False))
    def cut_power(self, draw: random.Random) -> None:
        self.lives += 1
        self.tally["power cuts"] += 1
        home = self.folder / str(self.lives)
        self.disk.cut_power(home, draw)
        self.leave()
        self.look_at(home)
        self.live_in(home)
        self.same()

    def leave(self) -> None:
        """End a life."""
        self.disk.mend()
        self.tally.update(self.disk.failed)
        self.close()
        self.taken.close()
        shutil.rmtree(self.disk.folder)

    def teardown(self) -> None:
        # Whatever failed before, the disk is let go of.
        with self.held, self.taken:
            self.reopen()
            self.leave()
