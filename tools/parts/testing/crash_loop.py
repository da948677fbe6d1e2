# SPDX-License-Identifier: GPL-2.0-or-later
"""A service that dies again and again: killed as soon as it runs."""
from collections.abc import Iterable

PAUSES = (0, 1, 2, 4)  # s, before it is started again for the first time, for the second ...; then always 8
KILLS = len(PAUSES) + 1
KILLED = "/run/killed"  # there is, of each service, when it was killed, and its status afterwards
# What runs is a script first, and at the end `finish`: only the program itself counts. The last pause is the longest
# one: long enough for its status to be seen. (One line, as a console takes it.)
SCRIPT = (f"attack() {{ last= kills=0 looks=0; : > {KILLED}.$1; "
          f"while [ $kills -lt {KILLS} ]; do read -r pid < /run/service/$1/supervise/pid; "
          'if [ "$pid" = "$last" ] || [ "$(readlink /proc/$pid/exe)" != /usr/bin/$1 ]; '
          "then usleep 20000; continue; fi; "
          f"read -r now rest < /proc/uptime; kill -9 $pid && echo $now >> {KILLED}.$1; "
          "last=$pid kills=$((kills + 1)); done; "
          f"until ddxctl status $1 > {KILLED}.$1.status; [ $? = 1 ] || [ $((looks += 1)) -gt 200 ]; "
          "do usleep 20000; done; }")


def at_once(names: Iterable[str]) -> str:
    """The command that does it to these services."""
    return f"{SCRIPT}; all=; for name in {' '.join(names)}; do attack $name & all=\"$all $!\"; done; wait $all"


def times(name: str) -> str:
    """The command that tells when one of them was killed."""
    return f"cat {KILLED}.{name}"


def status(name: str) -> str:
    """The command that tells how it was called during the pause that followed."""
    return f"cat {KILLED}.{name}.status"


def pauses(text: str) -> list[float]:
    """Seconds from each death to the next one, from what was told."""
    at = [float(word) for word in text.split()]
    return [round(later - sooner, 2) for sooner, later in zip(at, at[1:])]


def too_soon(found: list[float]) -> list[str]:
    """Pauses that were too short."""
    return [f"{pause} s instead of {wanted}" for pause, wanted in zip(found, PAUSES) if pause < wanted]
