"""Clock of CPU seconds: a module that imports this one before crosstrack limits and measures runs by CPU time.

A run on a busy machine then does the work of a run on an idle one. All threads of the process count.
"""

from __future__ import annotations

import threading
import time

#: Seconds between two looks at the clock.
STEP = 0.01


class Timer(threading.Timer):
    """Timer that calls its function after a number of CPU seconds of the process."""

    def run(self) -> None:
        """Wait until the CPU seconds are used, then call the function unless it was cancelled."""
        end = time.process_time() + self.interval
        while time.process_time() < end:
            if self.finished.wait(STEP):
                return
        self.function(*self.args, **self.kwargs)
        self.finished.set()


time.perf_counter = time.process_time
threading.Timer = Timer  # type: ignore[misc]
