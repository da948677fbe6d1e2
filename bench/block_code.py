# SPDX-License-Identifier: GPL-2.0-or-later
"""The block code of WFB-ng, a process: python -m bench.block_code send|receive FROM ADDRESS PORT

Eight packets to port FROM of this host make a block: each is forwarded at once, followed by four repair packets after
the eighth. `receive` forwards packets in order, those after a gap when their block or a newer block is complete.
Packet format: block (4 bytes), number in the block (1), length (2), data; repair packets cover length and data.
"""
import importlib
import socket
import struct
import sys
from collections.abc import Callable

zfec = importlib.import_module("zfec")  # an untyped module
WHOLE, ALL = 8, 12
HEAD = struct.Struct("!IB")
LENGTH = struct.Struct("!H")
OLD = 4  # blocks after which an incomplete one is given up
Send = Callable[[bytes], object]


class Sender:
    def __init__(self, send: Send) -> None:
        self.send, self.block, self.packets = send, 0, list[bytes]()
        self.encoder = zfec.Encoder(WHOLE, ALL)

    def take(self, packet: bytes) -> None:
        data = LENGTH.pack(len(packet)) + packet
        self.send(HEAD.pack(self.block, len(self.packets)) + data)
        self.packets.append(data)
        if len(self.packets) == WHOLE:
            longest = max(map(len, self.packets))
            padded = [one.ljust(longest, b"\0") for one in self.packets]
            for number, repair in enumerate(self.encoder.encode(padded, list(range(WHOLE, ALL))), WHOLE):
                self.send(HEAD.pack(self.block, number) + repair)
            self.block, self.packets = self.block + 1, []


class Receiver:
    def __init__(self, send: Send) -> None:
        self.send = send
        self.decoder = zfec.Decoder(WHOLE, ALL)
        self.blocks: dict[int, dict[int, bytes]] = {}
        self.next = (0, 0)  # block and number of the next packet to forward

    def take(self, packet: bytes) -> None:
        block, number = HEAD.unpack_from(packet)
        if block < self.next[0]:
            return
        known = self.blocks.setdefault(block, {})
        known[number] = packet[HEAD.size:]
        if len(known) >= WHOLE and any(one not in known for one in range(WHOLE)):
            self._restore(known)
        self._send_on()
        while block - self.next[0] >= OLD:
            self._give_up()
            self._send_on()

    def _restore(self, known: dict[int, bytes]) -> None:
        chosen = sorted(known)[:WHOLE]
        longest = max(len(known[one]) for one in chosen)
        restored = self.decoder.decode([known[one].ljust(longest, b"\0") for one in chosen], chosen)
        known.update(enumerate(restored))

    def _send_on(self) -> None:
        block, number = self.next
        while data := self.blocks.get(block, {}).get(number):
            length, = LENGTH.unpack_from(data)
            self.send(data[LENGTH.size:LENGTH.size + length])
            number += 1
            if number == WHOLE:
                self.blocks.pop(block)
                block, number = block + 1, 0
            self.next = block, number

    def _give_up(self) -> None:
        """Forward the known packets of the oldest block, and skip the missing ones."""
        block, number = self.next
        for one, data in sorted(self.blocks.pop(block, {}).items()):
            if number <= one < WHOLE:
                self.send(data[LENGTH.size:LENGTH.size + LENGTH.unpack_from(data)[0]])
        self.next = block + 1, 0


def main() -> None:
    role, source, address, port = sys.argv[1:]
    inlet, outlet = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    inlet.bind(("", int(source)))

    def send(packet: bytes) -> None:
        try:
            outlet.sendto(packet, (address, int(port)))
        except ConnectionRefusedError:
            pass  # the player does not run yet

    peer: Sender | Receiver = Sender(send) if role == "send" else Receiver(send)
    while True:
        peer.take(inlet.recv(65536))


if __name__ == "__main__":
    main()
