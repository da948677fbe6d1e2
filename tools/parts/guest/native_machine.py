# SPDX-License-Identifier: GPL-2.0-or-later
"""The development image's root file system, started on this machine's own kernel, without emulation, for tests with
thousands of repetitions.

Its init, runsvdir, scripts and programs run unchanged in their own namespaces (processes, mounts, network, host name).
Hardware is left out: there are only the devices of DEVICES (neither a camera nor a watchdog, so nothing can reset the
host), and disks are not checked. /data and /rec are folders that outlive the machine, so that the next one starts with
the same settings.
"""
import os
import pathlib
import subprocess
import tempfile

from parts.common import MORTAL, PATIENCE, Closing, Failed, wait_until
from parts.guest.robot import Robot
from parts.processes import kill

SCRIPTS = "S02base S[2-9]*"  # of /etc/init.d: folders and loopback, then the services
DEVICES = {"null": "1 3", "zero": "1 5", "full": "1 7", "random": "1 8", "urandom": "1 9", "tty": "5 0"}
# Replaces the image's inittab, which also opens consoles and looks for disks.
INITTAB = """\
::sysinit:/bin/sh /run/start
::respawn:/usr/bin/runsvdir -P /run/service
::shutdown:/etc/init.d/rcK
"""
START = f"""\
cd /run
touch provision provision.wrong
for script in $(cd /etc/init.d && echo {SCRIPTS}); do /etc/init.d/$script start; done > boot 2>&1
"""
# $1: mount point of the root, $2: the image's root, $3: folders that outlive the machine. The root is a separate file
# system, so that /data and /rec count as mounted.
SETUP = f"""\
set -e
mount -t overlay -o "ro,lowerdir=$2:$3/empty" root "$1"
mount -t proc -o nosuid,nodev,noexec proc "$1/proc"
mount --bind -o ro "$1/proc/sys" "$1/proc/sys"
mount -o remount,bind,ro "$1/proc/sys"
mount -t sysfs -o ro,nosuid,nodev,noexec sysfs "$1/sys"
mount -t tmpfs -o mode=755,nosuid,size=1m dev "$1/dev"
{"".join(f'mknod -m 666 "$1/dev/{name}" c {number}; ' for name, number in DEVICES.items())}
mount -t tmpfs -o mode=755,nosuid,nodev,size=16m run "$1/run"
mount -t tmpfs -o mode=1777,nosuid,nodev,size=16m tmp "$1/tmp"
for folder in data rec test; do mount --bind "$3/$folder" "$1/$folder"; done
cp "$3/start" "$1/run"
mount --bind "$3/inittab" "$1/etc/inittab"
exec chroot "$1" /sbin/init
"""
# Owners as in overlay/usr/libexec/ddx/recordings-disk: the recorder, and the logger.
OWNERS = {"rec": 903, "rec/log": 909}
GROUP = 900
ENTER = ("--mount", "--pid", "--net", "--uts", "--ipc", "--root", "--wd=/")
PATH = "PATH=/usr/sbin:/usr/bin:/sbin:/bin"


class NativeMachine(Closing, Robot):
    """One run of the machine. `keep` is a folder that outlives it, with /data, /rec and /test."""

    def __init__(self, root: pathlib.Path, keep: pathlib.Path) -> None:
        if os.geteuid() != 0:
            raise Failed("a machine in namespaces of its own takes root")
        self.keep = keep
        for name in ("data/ddx", "rec/log", "test", "empty"):
            (keep / name).mkdir(parents=True, exist_ok=True)
        for path, user in OWNERS.items():
            os.chown(keep / path, user, GROUP)
            (keep / path).chmod(0o2755)
        (keep / "inittab").write_text(INITTAB)
        (keep / "start").write_text(START)
        self._place = tempfile.TemporaryDirectory(prefix="ddx-")
        spaces = ("--mount", "--pid", "--net", "--uts", "--ipc", "--fork", "--kill-child")
        self.process = subprocess.Popen([*MORTAL, "unshare", *spaces, "sh", "-c", SETUP, "sh", self._place.name,
                                         str(root), str(keep)], stdin=subprocess.DEVNULL,
                                        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self.init = 0  # host PID of its init
        self._enter: list[str] = []
        self._wait_for_init()
        self.wait_until("pidof runsvdir")

    def _wait_for_init(self) -> None:
        """Wait until init runs: before that, the root may still be the host's."""
        children = pathlib.Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")

        def there() -> bool:
            if self.process.poll() is not None:
                raise Failed(f"no machine of its own: {self.process.stderr.read() if self.process.stderr else ''}")
            first = children.read_text().split()
            if not first or pathlib.Path(f"/proc/{first[0]}/comm").read_text() != "init\n":
                return False
            self.init = int(first[0])
            self._enter = ["nsenter", *ENTER, "--target", first[0], "env", "-i", PATH, "sh", "-c"]
            return True
        wait_until(there, "no machine of its own: its init does not come")

    def run(self, command: str, timeout: float = PATIENCE) -> tuple[int, str]:
        done = subprocess.run([*MORTAL, *self._enter, command], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, errors="replace", timeout=timeout)
        return done.returncode, done.stdout.strip()

    def wait_until(self, condition: str, timeout: float = PATIENCE, pause: float = 0.1) -> None:
        wait_until(lambda: self.run(condition)[0] == 0, f"not within the time: {condition}", pause, timeout)

    def wait_for_end(self) -> None:
        """Wait after a command to stop or restart: when init exits, all processes exit."""
        self.process.wait(PATIENCE)

    def end(self) -> None:
        """Kill it, like a power cut."""
        kill(self.process)
        if self.process.stderr:
            self.process.stderr.close()
        self._place.cleanup()
