# SPDX-License-Identifier: GPL-2.0-or-later
"""Connect this terminal to the guest's console; Ctrl-] leaves."""
import os
import select
import sys
import termios
import tty

from parts.common import say
from parts.guest.channel import Channel

ESCAPE = b"\x1d"  # Ctrl-]


def attach(channel: Channel) -> None:
    say("the guest's console (Ctrl-] leaves and ends the guest):")
    before = termios.tcgetattr(sys.stdin)
    connection = channel.raw
    connection.settimeout(None)
    try:
        tty.setraw(sys.stdin)
        channel.send("\n")
        while True:
            ready, _, _ = select.select([sys.stdin, connection], [], [])
            if sys.stdin in ready:
                data = os.read(sys.stdin.fileno(), 1024)
                if not data or ESCAPE in data:
                    return
                connection.sendall(data)
            if connection in ready:
                data = connection.recv(65536)
                if not data:
                    return
                os.write(sys.stdout.fileno(), data)
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
        say("")
