# SPDX-License-Identifier: GPL-2.0-or-later
"""A guest: QEMU with the image as it is flashed, booted by the board's firmware and the image's own loader."""
import json
import os
import pathlib
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable
from types import TracebackType

import machine as boards
from channel import Channel, Timeout
from common import OUTPUT, Failed, run, say
from disk import BOOT, Disk
from machine import Machine

PROBE_SECONDS = 10
TCG = "tcg,thread=multi"
USERSPACE = b"Starting base"  # our own scripts' first line
# With several processors under TCG, QEMU 7.2 may execute the breakpoint by which a kernel changes its own code (jump
# labels) after it is gone: once in some hundred boots, always before userspace. No image can help that.
STALE = b"Oops: int3"
BOOTS_AGAIN = 2


class Guest:
    """One run of a machine with an image; what it wrote is gone afterwards, the image stays as it was.

    `size` makes the disk larger than the image (bytes), `prepare` changes the disk before the boot, `keep` is a folder
    that outlives the guest, so that the next one goes on with the same disk."""

    def __init__(self, image: pathlib.Path, accel: str, machine: Machine | None = None, *, console: bool = True,
                 provision: str = "", environment: tuple[str, ...] = (), test_disk: pathlib.Path | None = None,
                 memory: int = 384, log: pathlib.Path | None = None, extra: tuple[str, ...] = (), size: int = 0,
                 prepare: Callable[[Disk], None] | None = None, keep: pathlib.Path | None = None) -> None:
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="ddx-", dir=os.environ.get("TMPDIR", "/tmp")))
        self.machine = machine or boards.machines(boards.DEV)[0]
        self.log = log or self.folder / "console.log"
        self._channels: dict[str, Channel] = {}
        again = keep is not None and (keep / "disk.qcow2").exists()
        if again:
            assert keep
            disk = keep / "disk.qcow2"
        else:
            new = Disk(image, keep or self.folder, size)
            disk = new.path
            self._set_boot_files(new, ("console=open\n" if console else "") + provision, environment)
            if prepare:
                prepare(new)
        command = [
            *self.machine.arguments(self.folder), "-accel", accel, "-smp", "2", "-m", str(memory),
            "-nodefaults", "-no-user-config", "-no-reboot", "-display", "none", "-vga", "std",
            "-rtc", "base=utc", "-device", "virtio-rng-pci", "-device", "virtio-serial-pci",
            "-drive", f"file={disk},format=qcow2,if=virtio,cache=unsafe,node-name=disk",
            "-chardev", f"socket,id=ttyS0,path={self.folder}/ttyS0,server=on,wait=off,logfile={self.log}",
            "-serial", "chardev:ttyS0",
            "-chardev", f"socket,id=qmp,path={self.folder}/qmp,server=on,wait=off", "-mon", "chardev=qmp,mode=control",
        ]
        for name in ["hvc0", "hvc1"]:
            command += ["-chardev", f"socket,id={name},path={self.folder}/{name},server=on,wait=off",
                        "-device", f"virtconsole,chardev={name}"]
        if test_disk:
            command += ["-drive", f"file={test_disk},format=raw,if=virtio,readonly=on"]
        self._command = [*command, *extra]
        self._again = BOOTS_AGAIN
        self._start()

    def _start(self) -> None:
        for name in ["hvc1", "ttyS0"]:
            (self.folder / name).unlink(missing_ok=True)
        self.log.unlink(missing_ok=True)
        self.begin = time.monotonic()
        self.process = subprocess.Popen(self._command, stdin=subprocess.DEVNULL,
                                        stderr=(self.folder / "qemu.log").open("w"))
        deadline = time.monotonic() + 10
        while not (self.folder / "hvc1").exists():
            if self.process.poll() is not None or time.monotonic() > deadline:
                raise Failed("QEMU: " + (self.folder / "qemu.log").read_text().strip())
            time.sleep(0.02)

    def _set_boot_files(self, disk: Disk, provision: str, environment: tuple[str, ...]) -> None:
        """ddx.txt and GRUB's variables (name=value), where the test wants others than the image has."""
        files = {}
        if provision:
            files["ddx.txt"] = self.folder / "ddx.txt"
            files["ddx.txt"].write_text(provision)
        if environment:
            files["grub/grubenv"] = self.folder / "grubenv"
            run(["grub-editenv", files["grub/grubenv"], "create"])
            run(["grub-editenv", files["grub/grubenv"], "set", *environment])
        if files:
            disk.set_boot_files(files)

    def snapshot(self) -> pathlib.Path:
        """The disk as it is now, as a plain file; from QEMU itself, so that what it has not written yet counts."""
        copy, link = self.folder / "snapshot.img", self.folder / "nbd"
        copy.unlink(missing_ok=True)
        self.monitor("nbd-server-start", addr={"type": "unix", "data": {"path": str(link)}})
        try:
            self.monitor("block-export-add", type="nbd", id="disk", **{"node-name": "disk"})
            run(["qemu-img", "convert", "-f", "raw", "-O", "raw", f"nbd+unix:///disk?socket={link}", copy])
        finally:
            self.monitor("nbd-server-stop")
        return copy

    def environment(self) -> dict[str, str]:
        """GRUB's variables, as they are on the disk now."""
        text = run(["mtype", "-i", f"{self.snapshot()}@@{BOOT}", "::grub/grubenv"])
        return dict(line.split("=", 1) for line in text.splitlines() if "=" in line and not line.startswith("#"))

    def __enter__(self) -> "Guest":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    def channel(self, name: str) -> Channel:
        """ttyS0, hvc0 or hvc1, as it is."""
        if name not in self._channels:
            self._channels[name] = Channel(self.folder / name)
        return self._channels[name]

    def shell(self, name: str = "hvc0", timeout: float = 90.0) -> Channel:
        """The channel with a shell behind it; waits for the boot."""
        if name not in self._channels:
            if not self._channels:
                self.wait_for_log(USERSPACE, timeout)
            try:
                self.channel(name).open_shell(timeout)
            except Timeout as error:
                tail = self.log.read_text(errors="replace")[-1500:] if self.log.exists() else ""
                raise Failed(f"the guest did not come up: {error}\n{tail}") from None
        return self._channels[name]

    def wait_for_log(self, text: bytes, timeout: float) -> None:
        """Until the serial line has said so, whether anybody was listening or not."""
        deadline = time.monotonic() + timeout
        while text not in (said := self.log.read_bytes() if self.log.exists() else b""):
            if STALE in said and USERSPACE not in said and not self._channels and self._again:
                self._again -= 1
                say("QEMU ran a breakpoint that the guest's kernel had removed; booting again ...")
                self.process.kill()
                self.process.wait()
                self._start()
                deadline = time.monotonic() + timeout
            if time.monotonic() > deadline or self.process.poll() is not None:
                raise Failed(f"the guest did not say {text!r} within {timeout:.0f} s")
            time.sleep(0.02)

    def sh(self, command: str, timeout: float = 30.0) -> str:
        """Run a command in the guest that has to succeed."""
        status, text = self.shell().run(command, timeout)
        if status != 0:
            raise Failed(f"in the guest: exit status {status}: {command}\n{text}")
        return text.strip()

    def monitor(self, command: str, **arguments: object) -> None:
        """One QMP command."""
        with socket.socket(socket.AF_UNIX) as connection:
            connection.connect(str(self.folder / "qmp"))
            file = connection.makefile("rw")
            for words in [{"execute": "qmp_capabilities"}, {"execute": command, "arguments": arguments}]:
                file.write(json.dumps(words) + "\n")
                file.flush()
                while "event" in (answer := json.loads(file.readline())) or "QMP" in answer:
                    pass
                if "error" in answer:
                    raise Failed(f"QEMU: {command}: {answer['error']}")

    def poweroff(self, timeout: float = 60.0) -> None:
        """Stop the guest by its own means, so that its file systems are clean."""
        self.shell().send("poweroff\n")
        try:
            self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise Failed("the guest did not power off") from None

    def close(self) -> None:
        for channel in self._channels.values():
            channel.close()
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(5)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)


Boot = Callable[..., Guest]  # starts a guest of a board that has been chosen: a log's name, and Guest()'s options


def _reaches_userspace(image: pathlib.Path, accel: str) -> bool:
    """Boot and wait for the first line of our own scripts."""
    try:
        with Guest(image, accel, console=False) as guest:
            deadline = time.monotonic() + PROBE_SECONDS
            while time.monotonic() < deadline and guest.process.poll() is None:
                if guest.log.exists() and USERSPACE in guest.log.read_bytes():
                    return True
                time.sleep(0.1)
    except Failed:
        pass
    return False


def acceleration(image: pathlib.Path) -> str:
    """What to run the guest with: ACCEL=, else KVM if a guest really runs under it, else multi-threaded TCG."""
    if os.environ.get("ACCEL"):
        accel = os.environ["ACCEL"]
        return TCG if accel == "tcg" else accel
    if not os.access("/dev/kvm", os.R_OK | os.W_OK):
        return TCG
    machine = pathlib.Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    cache = OUTPUT / "accel"
    if cache.exists() and cache.read_text().split()[0] == machine:
        return cache.read_text().split()[1]
    say("does KVM work here? ...")
    accel = "kvm" if _reaches_userspace(image, "kvm") else TCG
    say(f"does KVM work here? {'yes' if accel == 'kvm' else f'no userspace within {PROBE_SECONDS} s; using TCG'}")
    cache.write_text(f"{machine} {accel}\n")
    return accel
