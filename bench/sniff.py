# SPDX-License-Identifier: GPL-2.0-or-later
"""Count packets that contain these bytes, on all interfaces of the network namespace: python -m bench.sniff HEX.
Prints "ready", and answers each line of standard input with the count so far."""
import select
import socket
import sys

ETH_P_ALL = 3
BUFFER = 4 << 20


def main() -> None:
    mark, count = bytes.fromhex(sys.argv[1]), 0
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_ALL)) as packets:
        packets.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        print("ready", flush=True)
        while True:
            ready = select.select([packets, sys.stdin], [], [])[0]
            if packets in ready:  # before an answer, so that it is complete
                count += mark in packets.recv(65536)
            elif sys.stdin.readline():
                print(count, flush=True)
            else:
                return


if __name__ == "__main__":
    main()
