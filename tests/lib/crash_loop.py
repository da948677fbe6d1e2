# SPDX-License-Identifier: GPL-2.0-or-later
"""Kill a service repeatedly, each time as soon as it runs."""
from collections.abc import Iterable

PAUSES = (0, 1, 2, 4)  # s, before it is started again for the first time, for the second ...; then always 8
KILLS = len(PAUSES) + 1
KILLED = "/run/killed"  # files with the times of a service's kills, and its status afterwards
# Only the program itself is killed, not the script that starts it, nor `finish`. The status is read in the last pause,
# which is the longest. (A console takes one line.)
SCRIPT = (f"attack() {{ last= kills=0 looks=0; : > {KILLED}.$1; "
          f"while [ $kills -lt {KILLS} ]; do read -r pid < /run/service/$1/supervise/pid; "
          'if [ "$pid" = "$last" ] || [ "$(readlink /proc/$pid/exe)" != /usr/bin/$1 ]; '
          "then usleep 20000; continue; fi; "
          f"read -r now rest < /proc/uptime; kill -9 $pid && echo $now >> {KILLED}.$1; "
          "last=$pid kills=$((kills + 1)); done; "
          f"until ddxctl status $1 > {KILLED}.$1.status; [ $? = 1 ] || [ $((looks += 1)) -gt 200 ]; "
          "do usleep 20000; done; }")


def at_once(names: Iterable[str]) -> str:
    """The command that attacks these services at the same time."""
    return f"{SCRIPT}; all=; for name in {' '.join(names)}; do attack $name & all=\"$all $!\"; done; wait $all"


def times(name: str) -> str:
    """The command that prints the times of a service's kills."""
    return f"cat {KILLED}.{name}"


def status(name: str) -> str:
    """The command that prints a service's status during the last pause."""
    return f"cat {KILLED}.{name}.status"


def pauses(text: str) -> list[float]:
    """Seconds between the kills, from the output of times()."""
    at = [float(word) for word in text.split()]
    return [round(later - sooner, 2) for sooner, later in zip(at, at[1:])]


def too_soon(found: list[float]) -> list[str]:
    """Pauses that were too short."""
    return [f"{pause} s instead of {wanted}" for pause, wanted in zip(found, PAUSES) if pause < wanted]
