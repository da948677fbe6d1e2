# SPDX-License-Identifier: GPL-2.0-or-later
"""`make rollout` onto three machines: written by SSH, started in turn, and kept. tests/host/test_rollout.py has 50."""
import contextlib
import pathlib

import pytest

import rollout
from parts.common import run
from parts.guest.laptop import forward, free_port
from parts.guest.qemu import Boot, Guest
from rollout import Robot, Rollout

from . import slot_image

pytestmark = [pytest.mark.retry, pytest.mark.long]


def test_three_machines(boot: Boot, root: pathlib.Path, tmp_path: pathlib.Path,
                        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    _, file = slot_image.update(root, tmp_path)
    run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", tmp_path / "mine"])
    provision = f"network=eth0 dhcp\nssh_key={(tmp_path / 'mine.pub').read_text()}"
    ports = {f"robot{number}": free_port() for number in range(1, 4)}
    config = tmp_path / "config"
    config.write_text("".join(
        f"Host {name}\nHostName 127.0.0.1\nPort {port}\nIdentitiesOnly yes\nIdentityFile {tmp_path / 'mine'}\n"
        f"StrictHostKeyChecking accept-new\nUserKnownHostsFile {tmp_path / name}\n" for name, port in ports.items()))
    monkeypatch.setattr(rollout, "SSH", (*rollout.SSH, "-F", str(config)))
    with contextlib.ExitStack() as stack:
        guests: dict[str, Guest] = {}
        for name, port in ports.items():
            guests[name] = stack.enter_context(boot(name, provision=provision,
                                                    extra=(*forward(port), "-action", "reboot=reset")))
            guests[name].shell()
            guests[name].wait_until("netstat -tln | grep -q :22")
        call = Rollout(file, [Robot(name) for name in ports], tmp_path / "output", pause=2)
        call.run()
        said = capsys.readouterr().out
        assert [said.count(f"rollout: {name}: {what}") for name in ports for what in ("version", "restarts", "kept")] \
            == [1] * 9
        assert said.index("robot1: kept") < min(said.index(f"{name}: restarts") for name in ("robot2", "robot3"))
        for guest in guests.values():
            assert guest.environment() == {"slot": "B"}
        call.run()
        assert "restarts" not in (said := capsys.readouterr().out) and "is written" not in said
