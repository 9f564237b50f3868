"""Progress bars in a terminal, by rich; plain lines without a terminal."""

import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeRemainingColumn
from rich.progress import Progress as RichProgress


class Progress:
    """Context manager with one bar per run stage, its latest metrics and the remaining time."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        columns = (
            TextColumn("{task.description:<22}"), BarColumn(30), MofNCompleteColumn(), TimeRemainingColumn(),
            TextColumn("{task.fields[metrics]}"),
        )  # fmt: skip
        self._rich = RichProgress(*columns, console=self._console, disable=not sys.stderr.isatty())
        self._task: TaskID | None = None
        self._stage, self._total, self._done, self._started = "", 0, 0, time.perf_counter()

    def __enter__(self) -> "Progress":
        self._rich.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._rich.__exit__(kind, value, trace)

    def begin(self, stage: str, total: int) -> None:
        """Starts a run stage of `total` steps."""
        self._stage, self._total, self._done, self._started = stage, total, 0, time.perf_counter()
        self._task = self._rich.add_task(stage, total=total, metrics="")
        self.note(stage)

    def advance(self, steps: int, **metrics: float) -> None:
        """Advances the run stage by `steps` and shows its latest metrics."""
        text = "  ".join(
            f"{name} {value:,.3g}" if value < 1e4 else f"{name} {value:,.0f}" for name, value in metrics.items()
        )
        if self._task is not None:
            self._rich.update(self._task, advance=steps, metrics=text)
        self._done += steps
        if self._rich.disable:
            self.note("  ".join([f"{self._stage}: {self._done:,} of {self._total:,}", text]).rstrip())

    def note(self, text: str) -> None:
        """Prints a permanent line with the seconds since the run stage began."""
        seconds = time.perf_counter() - self._started
        self._console.print(f"[{seconds:6.1f} s] {text}", highlight=False, markup=False, soft_wrap=True)
