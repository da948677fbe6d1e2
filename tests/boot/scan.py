# SPDX-License-Identifier: GPL-2.0-or-later
"""A scan of all ports of a guest from outside. A port is closed only if the guest refuses it."""
import struct

from .outsider import ICMP, ICMP6, IP4, IP6, GUEST_MAC, IPV4, IPV6, TCP, UDP, Outsider, ethernet, ip

ALL = range(1, 65536)
OUR_PORT = 40000
ROUNDS = 6      # probes of a port that does not answer
PATIENCE = 3.0  # s for a round's last answers
SYN, RST, ACK = 2, 4, 16
UNREACHABLE = {ICMP: (3, 3), ICMP6: (1, 4)}  # type and code of "port unreachable"


class Scan:
    """Ports of TCP or UDP at one address of the guest."""

    def __init__(self, outsider: Outsider, protocol: int, address: bytes, ports: range) -> None:
        self.outsider, self.protocol, self.address, self.ports = outsider, protocol, address, ports
        self.closed: set[int] = set()
        self.open: set[int] = set()     # accepted the connection, or sent an answer

    @property
    def _our_address(self) -> bytes:
        return IPV4 if len(self.address) == 4 else IPV6

    def _packet(self, content: bytes) -> None:
        packet = ip(self._our_address, self.address, self.protocol, content)
        self.outsider.send(ethernet(GUEST_MAC, IP4 if len(self.address) == 4 else IP6, packet))

    def _probe(self, port: int) -> None:
        if self.protocol == TCP:
            self._tcp(port, 1000, SYN)
        else:
            self._packet(struct.pack("!HHHH", OUR_PORT, port, 8, 0))

    def _tcp(self, port: int, sequence: int, flags: int) -> None:
        self._packet(struct.pack("!HHIIBBHHH", OUR_PORT, port, sequence, 0, 5 << 4, flags, 1024, 0, 0))

    def _handle(self, frame: bytes) -> None:
        at = 34 if len(self.address) == 4 else 54
        if frame[26:30] != self.address if at == 34 else frame[22:38] != self.address:
            return
        protocol = frame[23] if at == 34 else frame[20]
        if protocol in UNREACHABLE:
            asked = frame[at + 8:]  # our packet, quoted
            if (frame[at], frame[at + 1]) == UNREACHABLE[protocol] and asked[9 if at == 34 else 6] == self.protocol:
                self.closed.add(int.from_bytes(asked[at - 14 + 2:at - 14 + 4], "big"))
        elif protocol == self.protocol:
            port = int.from_bytes(frame[at:at + 2], "big")
            if protocol == TCP and frame[at + 13] & RST:
                self.closed.add(port)
                return
            self.open.add(port)
            if protocol == TCP:
                self._tcp(port, 1001, RST)  # so that it does not wait for us

    def run(self) -> set[int]:
        """The ports that are not closed."""
        for _ in range(ROUNDS):
            left = [port for port in self.ports if port not in self.closed and port not in self.open]
            for port in left:
                self._probe(port)
                for frame in self.outsider.receive(0):
                    self._handle(frame)
            known = -1
            while known != len(self.closed | self.open):
                known = len(self.closed | self.open)
                for frame in self.outsider.receive(PATIENCE):
                    self._handle(frame)
            if known == len(self.ports):
                break
        return set(self.ports) - self.closed


def listening(outsider: Outsider, address: bytes, ports: range) -> set[tuple[str, int]]:
    """The ports that the guest does not refuse at this address."""
    return {(name, port) for name, protocol in (("tcp", TCP), ("udp", UDP))
            for port in Scan(outsider, protocol, address, ports).run()}
