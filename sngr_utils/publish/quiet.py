"""Whether a machine was quiet while something was timed.

CPU times grow by tens of per cent when other processes share caches and memory, even if each has
a core of its own, so that neither the clock on the wall nor the spread over repeats gives it away.
What the machine did meanwhile, beside this process, does.
"""

import os
from dataclasses import dataclass

import psutil


@dataclass(frozen=True)
class Reading:
    """CPU seconds since the machine started, of all cores together.

    Attributes
    ----------
    all : that there were
    busy : in which anything ran, here or in another machine on the same cores
    own : of this process and of those it has started and waited for
    """

    all: float
    busy: float
    own: float


def read() -> Reading:
    """The counters as they stand."""
    clock = psutil.cpu_times()._asdict()
    # what guests had is part of user and nice
    total = sum(spent for name, spent in clock.items() if not name.startswith("guest"))
    idle = clock["idle"] + clock.get("iowait", 0.0)
    return Reading(total, total - idle, sum(os.times()[:4]))


def others(before: Reading, after: Reading) -> float:
    """The share of the machine's time, between two readings, that other processes had."""
    busy, own = after.busy - before.busy, after.own - before.own
    return max(0.0, busy - own) / (after.all - before.all)
