# SPDX-License-Identifier: GPL-2.0-or-later
"""A guest: QEMU with the flashed image, booted by the board's firmware and the image's loader."""
import contextlib
import dataclasses
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import ClassVar

from parts.common import MORTAL, OUTPUT, PATIENCE, TOP, Failed, alone, copy, run, say, wait_until
from parts.disk.disk import BOOT, Disk
from parts.guest import machine as boards
from parts.guest.channel import Channel, Timeout, make_pipes
from parts.guest.machine import Machine
from parts.guest.qmp import Monitor, NotListening
from parts.guest.robot import Robot
from parts.processes import kill, stop

PROBE_SECONDS = 6
TCG = "tcg,thread=multi"
USERSPACE = b"Starting base"  # our own scripts' first line
# With several processors under TCG, QEMU 7.2 may execute the breakpoint by which a kernel changes its own code (jump
# labels) after it is gone: once in some hundred boots, always before userspace. No image can help that.
# And on a starved host the kernel's short look at the timer may end before QEMU has let it tick.
MACHINE_FAULTS = (b"Oops: int3", b"8254 timer not connected")
BOOTS_AGAIN = 2
CONSOLES = ["hvc0", "hvc1"]  # over pipes, see channel.py


def _drive(disk: Disk, machine: Machine, writes: pathlib.Path | None, test_disk: pathlib.Path | None,
           limits: str) -> list[str]:
    """QEMU's options for the disks; the guest boots from the first one."""
    file = {"driver": "qcow2", "file": {"driver": "file", "filename": str(disk.path)}}
    graph: dict[str, object] = {"node-name": "disk", "cache": {"no-flush": True}, **file}
    if writes:
        writes.write_bytes(b"")
        log = {"driver": "file", "filename": str(writes)}
        graph = {"driver": "blklogwrites", "node-name": "disk", "log": log, "file": file}
    before = []
    if limits:
        before = ["-object", f"throttle-group,id=limits,{limits}"]
        graph = {"driver": "throttle", "throttle-group": "limits", "node-name": "disk", "file": file,
                 "cache": {"no-flush": True}}
    after = ["-drive", f"file={test_disk},format=raw,if=virtio,readonly=on"] if test_disk else []
    return [*before, "-blockdev", json.dumps(graph), *machine.disk("disk"), *after]


class Guest(Robot):
    """One run of a machine with an image; writes are discarded afterwards, the image stays unchanged.

    `more_memory` (MiB) is added to the machine's, `size` (bytes) makes the disk larger than the image, `prepare`
    changes the disk before the boot, `keep` is a folder that outlives the guest, so that the next one has the same
    disk, `writes` is a file for a log of all writes to the disk (blocklog.py), `bus` is the disk's (machine.py),
    `limits` are those of its speed (words of QEMU's throttle-group). With one of `processors` an emulated boot takes
    less of the host's time: two of them wait for each other."""

    started = 0  # number of guests that this process started
    alive: ClassVar[list["Guest"]] = []
    # Guests kept for a later test: at most one of them runs, and none while another guest starts.
    kept: ClassVar[list["Guest"]] = []
    # Called before a guest is stopped; the flag: because of an error.
    witness: ClassVar[Callable[["Guest", bool], None] | None] = None

    def __init__(self, image: pathlib.Path, accel: str, machine: Machine | None = None, *, console: bool = True,
                 serial: bool = False, screen: bool = False, provision: str = "", environment: tuple[str, ...] = (),
                 test_disk: pathlib.Path | None = None, more_memory: int = 0, log: pathlib.Path | None = None,
                 extra: tuple[str, ...] = (), size: int = 0, prepare: Callable[[Disk], None] | None = None,
                 keep: pathlib.Path | None = None, writes: pathlib.Path | None = None, bus: str = "", limits: str = "",
                 processors: int = 2) -> None:
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="ddx-", dir=os.environ.get("TMPDIR", "/tmp")))
        with contextlib.ExitStack() as undo:
            undo.callback(shutil.rmtree, self.folder, ignore_errors=True)
            self.machine = machine or boards.machines(boards.DEV)[0]
            if bus:
                self.machine = dataclasses.replace(self.machine, bus=bus)
            self.log = log or self.folder / "console.log"
            self._channels: dict[str, Channel] = {}
            again = keep is not None and (keep / "disk.qcow2").exists()
            disk = Disk(image, keep or self.folder, size)
            if not again:
                provision = ("console=open\n" if console else "") + ("test=yes\n" if test_disk else "") + provision
            self._set_boot_files(disk, provision, environment, serial, screen)
            if prepare:
                prepare(disk)
            self._command = [*MORTAL, *self.machine.arguments(self.folder, more_memory),
                             *self._devices(accel, processors),
                             *_drive(disk, self.machine, writes, test_disk, limits), *extra]
            self._again = BOOTS_AGAIN
            self._paused = False
            self._disk, self._before, self._writes = disk.path, self.folder / "before.qcow2", writes
            copy(self._disk, self._before)
            self._rest()
            self._start()
            undo.pop_all()
        Guest.alive.append(self)

    def _devices(self, accel: str, processors: int) -> list[str]:
        words = [
            "-accel", accel, "-smp", str(processors), "-nodefaults", "-no-user-config", "-no-reboot",
            "-display", "none", "-vga", "std", "-rtc", "base=utc",
            "-device", "virtio-rng-pci", "-device", "virtio-serial-pci",
            "-chardev", f"socket,id=ttyS0,path={self.folder}/ttyS0,server=on,wait=off,logfile={self.log}",
            "-serial", "chardev:ttyS0",
            "-chardev", f"socket,id=qmp,path={self.folder}/qmp,server=on,wait=off", "-mon", "chardev=qmp,mode=control"]
        for name in CONSOLES:
            words += ["-chardev", f"pipe,id={name},path={self.folder}/{name}",
                      "-device", f"virtconsole,chardev={name}"]
        return words

    def _start(self) -> None:
        for name in ["ttyS0", "qmp"]:
            (self.folder / name).unlink(missing_ok=True)
        for name in CONSOLES:
            make_pipes(self.folder / name)
        self.log.unlink(missing_ok=True)
        Guest.started += 1
        self.begin = time.monotonic()
        with (self.folder / "qemu.log").open("w") as words:
            self.process = subprocess.Popen(self._command, stdin=subprocess.DEVNULL, stderr=words)

        def answers() -> bool:
            if self.process.poll() is not None:
                raise Failed("QEMU does not start")
            try:
                with Monitor(self.folder / "qmp"):  # answers when all devices exist
                    return True
            except NotListening:  # QEMU makes the socket's name before it listens
                return False

        try:
            wait_until(answers, "QEMU does not start", patience=PATIENCE)
        except BaseException as error:
            kill(self.process)
            if isinstance(error, Failed):
                raise Failed(f"{error}: {self.words()}") from None
            raise

    def _set_boot_files(self, disk: Disk, provision: str, environment: tuple[str, ...],
                        serial: bool, screen: bool) -> None:
        """Write ddx.txt and GRUB's variables (name=value) if the test needs other ones, and whether menu and shell use
        the serial line and GRUB sets a graphics mode."""
        files = {}
        if serial:
            files["serial-on.txt"] = TOP / "board/common/serial-off.txt"
        if screen:
            files["screen-on.txt"] = TOP / "board/common/screen-off.txt"
        if provision:
            files["ddx.txt"] = self.folder / "ddx.txt"
            files["ddx.txt"].write_text(provision)
        if environment:
            files["grub/grubenv"] = self.folder / "grubenv"
            run(["grub-editenv", files["grub/grubenv"], "create"])
            run(["grub-editenv", files["grub/grubenv"], "set", *environment])
        if files:
            disk.set_boot_files(files)

    def pause(self) -> None:
        """Pause the VM until its next use, so that it takes no CPU."""
        if not self._paused and self.process.poll() is None:
            self.monitor("stop")
            self._paused = True

    def _rest(self) -> None:
        for other in Guest.kept:
            if other is not self:
                other.pause()

    def _wake(self) -> None:
        if self._paused:
            self._paused = False
            self._rest()
            self.monitor("cont")

    def snapshot(self) -> pathlib.Path:
        """The present content of the disk as a plain file; QEMU exports it, so that unwritten data is included."""
        image, link = self.folder / "snapshot.img", self.folder / "nbd"
        image.unlink(missing_ok=True)
        self.monitor("nbd-server-start", addr={"type": "unix", "data": {"path": str(link)}})
        try:
            self.monitor("block-export-add", type="nbd", id="disk", **{"node-name": "disk"})
            run(["qemu-img", "convert", "-f", "raw", "-O", "raw", f"nbd+unix:///disk?socket={link}", image],
                timeout=PATIENCE)
        finally:
            self.monitor("nbd-server-stop")
        return image

    def environment(self) -> dict[str, str]:
        """GRUB's variables on the disk."""
        text = run(["mtype", "-i", f"{self.snapshot()}@@{BOOT}", "::grub/grubenv"], timeout=PATIENCE)
        return dict(line.split("=", 1) for line in text.splitlines() if "=" in line and not line.startswith("#"))

    def __enter__(self) -> "Guest":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        try:
            if Guest.witness and not isinstance(error, KeyboardInterrupt):
                Guest.witness(self, error is not None)
        finally:
            self.close()

    @property
    def opened(self) -> Mapping[str, Channel]:
        """The channels that are in use."""
        return self._channels

    @property
    def paused(self) -> bool:
        return self._paused

    def channel(self, name: str) -> Channel:
        """The channel ttyS0, hvc0 or hvc1, without waiting for a shell."""
        self._wake()
        if name not in self._channels:
            self._channels[name] = Channel(self.folder / name)
        return self._channels[name]

    def shell(self, name: str = "hvc0", timeout: float = PATIENCE) -> Channel:
        """The channel to a shell; waits for the boot."""
        self._wake()
        if name not in self._channels:
            if not self._channels:
                self.wait_for_log(USERSPACE, timeout)
            try:
                self.channel(name).open_shell(timeout)
            except Timeout as error:
                tail = self._said().decode(errors="replace")[-1500:]
                gone = self.process.poll()
                why = "" if gone is None else f"; QEMU exited with status {gone}: {self.words()}"
                raise Failed(f"the guest did not come up: {error}{why}\n{tail}") from None
        return self._channels[name]

    def wait_for_log(self, text: bytes, timeout: float = PATIENCE) -> None:
        """Wait until the log of the serial line contains the text."""
        self._wake()
        deadline = time.monotonic() + timeout
        while text not in self._said():
            if not self._channels and self.boots_again():
                deadline = time.monotonic() + timeout
            if self.process.poll() is not None:
                raise Failed(f"QEMU exited with status {self.process.returncode} before the guest printed {text!r}: "
                             f"{self.words()}")
            if time.monotonic() > deadline:
                raise Failed(f"the guest did not print {text!r} within {timeout:.0f} s")
            time.sleep(0.02)

    def words(self) -> str:
        """QEMU's stderr."""
        return (self.folder / "qemu.log").read_text(errors="replace").strip()

    def _said(self) -> bytes:
        return self.log.read_bytes() if self.log.exists() else b""

    def boots_again(self) -> bool:
        """Whether QEMU failed the guest before userspace: it crashed, or its processor or timer misled the kernel. Then
        QEMU starts again with the disk as it was before the boot, and channels are closed."""
        said = self._said()
        crashed = (self.process.poll() or 0) < 0
        if USERSPACE in said or not (crashed or any(fault in said for fault in MACHINE_FAULTS)) or not self._again:
            return False
        self._again -= 1
        fault = f"was stopped by signal {-self.process.returncode}" if crashed else "failed the guest's kernel"
        say(f"QEMU {fault}; booting again ...")
        kill(self.process)
        self.reset()
        copy(self._before, self._disk)  # where GRUB has counted the boot that failed
        if self._writes:
            self._writes.write_bytes(b"")
        self._start()
        return True

    def run(self, command: str, timeout: float = PATIENCE) -> tuple[int, str]:
        return self.shell().run(command, timeout)

    def wait_for_event(self, name: str, timeout: float = PATIENCE) -> None:
        """Wait until QEMU reports the event: RESET, WATCHDOG, SHUTDOWN ..."""
        self._wake()
        with Monitor(self.folder / "qmp", timeout) as monitor:
            monitor.wait_for(name)

    def reset(self) -> None:
        """Forget the channels, after the machine has started again."""
        for channel in self._channels.values():
            channel.close()
        self._channels.clear()

    def monitor(self, command: str, **arguments: object) -> None:
        """One QMP command."""
        self._wake()
        with Monitor(self.folder / "qmp") as monitor:
            monitor.execute(command, **arguments)

    def screen(self) -> bytes:
        """A screenshot (PPM), taken while the guest is stopped."""
        self._wake()
        picture = self.folder / "screen.ppm"
        with Monitor(self.folder / "qmp") as monitor:
            monitor.execute("stop")
            monitor.execute("screendump", filename=str(picture))
            monitor.execute("cont")
        return picture.read_bytes()

    def poweroff(self, timeout: float = PATIENCE) -> None:
        """Shut the guest down, so that its file systems are clean."""
        self.shell().begin("poweroff")
        try:
            self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise Failed("the guest did not power off") from None

    def close(self) -> None:
        if self in Guest.alive:
            Guest.alive.remove(self)
        for channel in self._channels.values():
            channel.close()
        stop(self.process)
        shutil.rmtree(self.folder, ignore_errors=True)


Boot = Callable[..., Guest]  # starts a guest of the chosen board; arguments: name of the log, options of Guest()


def _reaches_userspace(image: pathlib.Path, accel: str) -> bool:
    """Boot, and wait for the first line of our scripts."""
    try:
        with Guest(image, accel, console=False) as guest:
            deadline = time.monotonic() + PROBE_SECONDS
            while time.monotonic() < deadline and guest.process.poll() is None:
                if guest.log.exists() and USERSPACE in guest.log.read_bytes():
                    return True
                if b"KVM internal error" in (guest.folder / "qemu.log").read_bytes():
                    return False
                time.sleep(0.1)
    except Failed:
        pass
    return False


def acceleration(image: pathlib.Path) -> str:
    """QEMU's accelerator: ACCEL=, else KVM if a guest boots with it, else multi-threaded TCG."""
    if os.environ.get("ACCEL"):
        accel = os.environ["ACCEL"]
        return TCG if accel == "tcg" else accel
    if not os.access("/dev/kvm", os.R_OK | os.W_OK):
        return TCG
    machine = pathlib.Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    cache = OUTPUT / "accel"
    with alone("look for KVM", OUTPUT / "accel.lock"):  # each process of the tests asks
        if cache.exists() and cache.read_text().split()[0] == machine:
            return cache.read_text().split()[1]
        say("does KVM work here? ...")
        accel = "kvm" if _reaches_userspace(image, "kvm") else TCG
        say(f"does KVM work here? {'yes' if accel == 'kvm' else f'no userspace within {PROBE_SECONDS} s; using TCG'}")
        cache.write_text(f"{machine} {accel}\n")
        return accel
