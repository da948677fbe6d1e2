# SPDX-License-Identifier: GPL-2.0-or-later
"""RTP over a lossy link with Debian's GStreamer: retransmission, ULPFEC, a block code."""
import shlex
import subprocess
import sys

from bench.clips import HEIGHT, PICTURE, RATE, WIDTH
from bench.loss_peers import PORT, Peer, Piped
from parts.link.link import Node

MEDIA, EXTRA = 96, 97  # payload types
CAPS = f"application/x-rtp,media=video,clock-rate=90000,encoding-name=H264,payload={MEDIA}"


class GStreamer(Piped):
    latency_ms = 80

    def encoder(self) -> str:
        return (f"fdsrc fd=0 blocksize={PICTURE} ! rawvideoparse format=i420 width={WIDTH} height={HEIGHT} "
                f"framerate={RATE}/1 ! x264enc tune=zerolatency speed-preset=superfast bitrate={self.video_kbit} "
                f"vbv-buf-capacity=100 key-int-max={RATE} intra-refresh=true option-string=no-psy=1 "
                f"! rtph264pay pt={MEDIA} config-interval=-1 mtu=1200")

    def decoder(self) -> str:
        return "rtph264depay ! avdec_h264 max-threads=1 ! video/x-raw,format=I420 ! fdsink fd=1 sync=false"

    def words(self, pipeline: str) -> list[str]:
        return ["gst-launch-1.0", "-q", *shlex.split(pipeline)]


class Retransmission(GStreamer):
    """rtprtxsend: the receiver's jitter buffer requests missing packets (RFC 4585, RFC 4588). Without this bandwidth,
    its requests would wait for seconds."""
    SESSION = "rtpsession name=s rtp-profile=avpf bandwidth=1000000 rtcp-min-interval=0"
    name, video_kbit, deadline_ms = "GStreamer rtx 80 ms", 150, Peer.deadline_ms

    def rtcp(self, host: str) -> str:
        return (f"s.send_rtcp_src ! udpsink host={host} port={PORT + 1} sync=false async=false "
                f"udpsrc port={PORT + 1} ! s.recv_rtcp_sink")

    def types(self) -> str:
        return f'payload-type-map="application/x-rtp-pt-map,{MEDIA}=(uint){EXTRA}"'

    def sender_words(self, to: str) -> list[str]:
        return self.words(f"{self.SESSION} {self.encoder()} ! rtprtxsend {self.types()} "
                          f"max-size-packets=500 ! s.send_rtp_sink "
                          f"s.send_rtp_src ! udpsink host={to} port={PORT} sync=false async=false {self.rtcp(to)}")

    def receiver_words(self, robot: str) -> list[str]:
        return self.words(f"{self.SESSION} udpsrc port={PORT} caps={CAPS} ! s.recv_rtp_sink "
                          f"s.recv_rtp_src ! rtprtxreceive {self.types()} ! rtpssrcdemux ! rtpjitterbuffer "
                          f"do-retransmission=true do-lost=true latency={self.latency_ms} rtx-delay=5 "
                          f"rtx-retry-timeout=20 ! {self.decoder()} {self.rtcp(robot)}")


class Fec(GStreamer):
    """rtpulpfecenc (RFC 5109): a repair packet for each packet. The jitter buffer waits for more than its latency."""
    name, reports, video_kbit = "GStreamer ULPFEC", False, 100
    deadline_ms = 1000

    def sender_words(self, to: str) -> list[str]:
        return self.words(f"{self.encoder()} ! rtpulpfecenc pt={EXTRA} percentage=100 percentage-important=100 "
                          f"! udpsink host={to} port={PORT} sync=false async=false")

    def receiver_words(self, robot: str) -> list[str]:
        return self.words(f"udpsrc port={PORT} caps={CAPS} ! rtpstorage size-time=250000000 ! rtpssrcdemux ! {CAPS} "
                          f"! rtpjitterbuffer do-lost=true latency={self.latency_ms} ! rtpulpfecdec pt={EXTRA} "
                          f"! {self.decoder()}")


class BlockCode(GStreamer):
    """WFB-ng's code: four repair packets for eight packets, python3-zfec (bench/block_code.py)."""
    name, reports, video_kbit, deadline_ms = "block code 8/12", False, 105, Peer.deadline_ms
    LOCAL = 9000

    def _code(self, node: Node, role: str, source: int, address: str, port: int) -> None:
        self.start(node, [sys.executable, "-B", "-m", "bench.block_code", role, str(source), address, str(port)],
                   f"code-{role}", subprocess.DEVNULL, subprocess.DEVNULL)

    def receive(self) -> None:
        self._code(self.link.operator[0], "receive", PORT, "127.0.0.1", self.LOCAL)
        super().receive()

    def send(self) -> None:
        self._code(self.link.robot, "send", self.LOCAL, self.link.operator[0].address, PORT)
        super().send()

    def sender_words(self, to: str) -> list[str]:
        return self.words(f"{self.encoder()} ! udpsink host=127.0.0.1 port={self.LOCAL} sync=false async=false")

    def receiver_words(self, robot: str) -> list[str]:
        return self.words(f"udpsrc port={self.LOCAL} caps={CAPS} ! {self.decoder()}")
