# SPDX-License-Identifier: GPL-2.0-or-later
"""Updates: what is refused, with nothing written; and what a failure leaves."""
from __future__ import annotations

import base64
import dataclasses
import io
import json
import pathlib
import subprocess
import tarfile
from collections.abc import Callable, Iterator

import pytest

from parts import trees
from parts.common import BadInput, run
from parts.disk.logged_device import lacking
from parts.image import native
from parts.release import update_file
from parts.release.update_file import MEMBERS

from .programs import library_folder
from .update_disk import FORMER, NEW, RUNNING, UpdateDisk

pytestmark = [pytest.mark.computes, pytest.mark.retry]

Members = list[tuple[str, bytes]]


@pytest.fixture(name="disk", scope="module")
def _disk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[UpdateDisk]:
    if reason := lacking():
        pytest.skip(reason)
    with UpdateDisk(tmp_path_factory.mktemp("update"), "A") as disk:
        yield disk


def members(disk: UpdateDisk, what: update_file.Release = NEW, **changes: bytes) -> Members:
    text = update_file.manifest(what, disk.roots[NEW])
    found = {"manifest": text, "manifest.minisig": update_file.sign(text, disk.key), "root": disk.roots[NEW]}
    return [(name, changes.get(name.replace(".", "_"), found[name])) for name in MEMBERS]


def with_text(disk: UpdateDisk, text: bytes) -> bytes:
    """Signed, whatever the manifest has."""
    return update_file.archive(members(disk, manifest=text, manifest_minisig=update_file.sign(text, disk.key)))


def other_key(disk: UpdateDisk) -> bytes:
    key = disk.folder / "other.key"
    if not key.exists():
        update_file.make_key(key, "-W")
    return update_file.make(NEW, disk.roots[NEW], key)


def forged(disk: UpdateDisk) -> bytes:
    """Signed by another key, with the number of the trusted one."""
    text = update_file.manifest(NEW, disk.roots[NEW])
    other_key(disk)
    lines = update_file.sign(text, disk.folder / "other.key").decode().splitlines()
    good = base64.b64decode(update_file.sign(text, disk.key).decode().splitlines()[1])
    bad = base64.b64decode(lines[1])
    lines[1] = base64.b64encode(good[:10] + bad[10:]).decode()
    return update_file.archive(members(disk, manifest_minisig="".join(f"{line}\n" for line in lines).encode()))


def comment(disk: UpdateDisk) -> bytes:
    text = update_file.manifest(NEW, disk.roots[NEW])
    changed = update_file.sign(text, disk.key).replace(b"trusted comment: timestamp", b"trusted comment: Timestamp")
    return update_file.archive(members(disk, manifest_minisig=changed))


def legacy(disk: UpdateDisk) -> bytes:
    text = update_file.manifest(NEW, disk.roots[NEW])
    return update_file.archive(members(disk, manifest_minisig=update_file.sign(text, disk.key, "-l")))


def changed(disk: UpdateDisk) -> bytes:
    """The manifest, after it was signed."""
    text = update_file.manifest(NEW, disk.roots[NEW]).replace(b"serial=2000", b"serial=3000")
    return update_file.archive(members(disk, manifest=text))


def in_order(disk: UpdateDisk, *order: int) -> bytes:
    found = members(disk)
    return update_file.archive([found[one] for one in order])


def gnu(disk: UpdateDisk) -> bytes:
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w", format=tarfile.GNU_FORMAT) as tar:
        for name, content in members(disk):
            entry = tarfile.TarInfo(name)
            entry.size = len(content)
            tar.addfile(entry, io.BytesIO(content))
    return file.getvalue()


def too_large(disk: UpdateDisk) -> bytes:
    return update_file.make(NEW, bytes((3 << 20) + 512), disk.key)


def release(disk: UpdateDisk, **changes: str) -> bytes:
    return disk.update(dataclasses.replace(NEW, **changes))


REFUSED: list[tuple[str, Callable[[UpdateDisk], bytes], str]] = [
    ("empty", lambda disk: b"", "is cut short"),
    ("no-archive", lambda disk: b"x" * 5000, "its member 'manifest' is not where it should be"),
    ("cut", lambda disk: disk.update()[:2_000_000], "is cut short"),
    ("order", lambda disk: in_order(disk, 1, 0, 2), "its member 'manifest' is not where it should be"),
    ("no-signature", lambda disk: in_order(disk, 0, 2), "its member 'manifest.minisig' is not where it should be"),
    ("no-root", lambda disk: in_order(disk, 0, 1), "its member 'root' is not where it should be"),
    ("gnu", gnu, "its member 'manifest' is not where it should be"),
    ("root-short", lambda disk: update_file.archive(members(disk, root=disk.roots[NEW][:-512])),
     "its member 'root' has a wrong length"),
    ("manifest-long", lambda disk: with_text(disk, b"x" * 16385), "its member 'manifest' has a wrong length"),
    ("manifest-nonsense", lambda disk: with_text(disk, b"board=test\nlayout=one\n"), "can read: layout"),
    ("manifest-extra", lambda disk: with_text(disk, update_file.manifest(NEW, disk.roots[NEW]) + b"x=1\n"), "the end"),
    ("too-large", too_large, "version 0.3.0 (new) is too large for slot B"),
    ("board", lambda disk: release(disk, board="other"), "is for the board other, this is a test"),
    ("layout", lambda disk: release(disk, layout="2"), "is for a disk with layout 2, this one has 1"),
    ("older", lambda disk: release(disk, serial="999"), "is older than this one (1000); -older allows that"),
    ("unknown-key", other_key, "signed with a key that this image does not trust"),
    ("forged", forged, "the signature is wrong"),
    ("comment", comment, "the signature is wrong"),
    ("legacy", legacy, "the signature has the legacy form"),
    ("no-minisig", lambda disk: update_file.archive(members(disk, manifest_minisig=b"x\ny\n")),
     "the signature is not one of minisign's"),
    ("changed", changed, "the signature is wrong: the file was changed after it was signed"),
]


def refused(disk: UpdateDisk, done: subprocess.CompletedProcess[str], before: bytes, said: str) -> None:
    assert (done.returncode, done.stdout) == (2, "") and said in done.stderr, done
    assert done.stderr.startswith("ddxupdate: ") and done.stderr.count("\n") == 1
    assert disk.content() == before and not list((disk.place / "data").glob("update*"))


@pytest.mark.parametrize("make, said", [pytest.param(*words, id=name) for name, *words in REFUSED])
def test_a_file_is_refused(disk: UpdateDisk, make: Callable[[UpdateDisk], bytes], said: str) -> None:
    before = disk.content()
    refused(disk, disk.run("write", stdin=make(disk)), before, said)


@pytest.mark.parametrize("file, text, said", [
    ("proc/cmdline", "ddx.slot=A\n", "the boot menu of this card is too old for updates; flash the card once more"),
    ("proc/cmdline", "ddx.layout=1\n", "not started by the appliance's boot loader"),
    ("run/slot.wrong", "boots are not counted\n", "boots are not counted"),
    ("etc/ddx/update-keys/test.pub", "", "this image has no key"),
])
def test_a_machine_is_refused(disk: UpdateDisk, file: str, text: str, said: str) -> None:
    before, path = disk.content(), disk.place / file
    kept = path.read_text() if path.exists() else None
    if text:
        path.write_text(text)
    else:
        path.unlink()
    done = disk.run("write", stdin=disk.update())
    if kept is None:
        path.unlink()
    else:
        path.write_text(kept)
    refused(disk, done, before, said)


def test_a_version_below_the_oldest_is_refused(disk: UpdateDisk) -> None:
    before, older = disk.content(), disk.update(dataclasses.replace(NEW, serial="899"))
    disk.release(oldest="900")
    refused(disk, disk.run("write", "-older", stdin=older), before, "is too old for this one, which goes back to 900")
    for command in ("start", "back"):
        refused(disk, disk.run(command), before, "is too old for this one, which goes back to 900")
    disk.release()


def test_a_second_update_is_refused(disk: UpdateDisk) -> None:
    before = disk.content()
    with subprocess.Popen(["flock", disk.place / "run/update.lock", "sh", "-c", "echo; read -r word"],
                          stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout and holder.stdout.readline()
        refused(disk, disk.run("write", stdin=disk.update()), before, "another update is at work")
        holder.communicate()


def test_an_older_version_is_not_started_by_accident(disk: UpdateDisk) -> None:
    before = disk.content()
    refused(disk, disk.run("start"), before, "version 0.1.0 (former) (serial 500) is older than this one (1000)")


def test_status(disk: UpdateDisk) -> None:
    before, done = disk.content(), disk.run("status", "-json")
    slots = {"A": {"version": RUNNING.version, "serial": 1000}, "B": {"version": FORMER.version, "serial": 500}}
    assert json.loads(done.stdout) == {"running": "A", "chosen": "A", "last": "none", "reason": "", "trial": "",
                                       "slots": slots}
    assert disk.run("status").stdout == ("slot A, running, started next: version 0.2.0 (running), serial 1000\n"
                                         "slot B: version 0.1.0 (former), serial 500\n")
    assert disk.content() == before


def test_bad_usage() -> None:
    program = native.build() / "usr/libexec/ddx/ddxupdate"
    for words in ("", "-root", "-root /x", "write", "write a b", "block a b c", "keep a b", "return -reason a b c"):
        done = subprocess.run([program, *words.split()], capture_output=True, text=True, check=False,
                              env={"LD_LIBRARY_PATH": str(library_folder())})
        assert (done.returncode, done.stderr) == (2, "ddxupdate: bad usage; see ddxupdate -help\n"), words


@pytest.fixture(name="fresh")
def _fresh(tmp_path: pathlib.Path) -> Iterator[UpdateDisk]:
    if reason := lacking():
        pytest.skip(reason)
    with UpdateDisk(tmp_path, "A") as disk:
        yield disk


def test_there_and_back(fresh: UpdateDisk) -> None:
    """By a pipe, as through ssh."""
    assert fresh.run("write", stdin=fresh.update(), pipe=True).stdout == (
        "slot B: version 0.3.0 (new); `ddxctl update start` restarts into it\n")
    assert fresh.block() == {} and fresh.slot("B").startswith(fresh.roots[NEW])
    assert fresh.run("start").stdout == "slot B is started next: version 0.3.0 (new)\n"
    assert fresh.block() == {"slot": "B", "left": "3"}
    state = (fresh.place / "data/update").read_text()
    assert state.startswith("proven=A\ntried=B\nversion=0.3.0 (new)\nresult=begun\nreason=\nseen=no\nruns=\n")
    assert json.loads(fresh.run("status", "-json").stdout)["last"] == "chosen"

    # its trial: no other update now
    fresh.words("ddx.slot=B ddx.layout=1 ddx.counted=left=3")
    fresh.release(NEW)
    assert json.loads(fresh.run("status", "-json").stdout)["last"] == "trial"
    for command in ("write", "start"):
        done = fresh.run(command, stdin=fresh.update())
        assert done.returncode == 2 and "this version is on trial" in done.stderr
    assert fresh.run("block").returncode == 3
    assert fresh.block() == {"slot": "B", "left": "3"}
    assert fresh.run("keep").returncode == 0
    assert fresh.block() == {"slot": "B"}
    assert json.loads(fresh.run("status", "-json").stdout)["last"] == "kept"

    assert fresh.run("back").stdout == "slot A is started next: version 0.2.0 (running)\n"
    assert fresh.block() == {"left": "3"}


def test_a_technician_takes_a_version_back(fresh: UpdateDisk) -> None:
    for command in ("write", "start"):
        assert fresh.run(command, stdin=fresh.update()).returncode == 0
    fresh.words("ddx.slot=B ddx.layout=1 ddx.counted=left=3")
    fresh.release(NEW)
    assert fresh.run("back").stdout == "slot A is started next\n"
    assert fresh.block() == {"failed": "B"}
    fresh.words("ddx.slot=A ddx.layout=1 ddx.counted=begun=1")
    fresh.release(RUNNING)
    assert fresh.run("ended").returncode == 0
    status = json.loads(fresh.run("status", "-json").stdout)
    assert (status["last"], status["reason"]) == ("returned", "a technician has taken it back")
    assert fresh.run("seen").returncode == 0
    assert fresh.block() == {} and "seen=yes" in (fresh.place / "data/update").read_text()


def test_an_older_version_by_request(fresh: UpdateDisk) -> None:
    """`start` with the one that was there, and `write`, which chooses the running slot again."""
    assert fresh.run("start", "-older").stdout == "slot B is started next: version 0.1.0 (former)\n"
    assert fresh.block() == {"slot": "B", "left": "3"}
    older = fresh.update(dataclasses.replace(NEW, serial="999"))
    assert fresh.run("write", "-older", stdin=older).returncode == 0
    assert fresh.block() == {} and fresh.slot("B").startswith(fresh.roots[NEW])


def test_a_key_takes_the_place_of_another(fresh: UpdateDisk) -> None:
    """An image has the new key before the old one is left out, which revokes that."""
    keys, before = fresh.place / "etc/ddx/update-keys", fresh.content()
    (keys / "new.pub").write_text(update_file.make_key(fresh.folder / "new.key", "-W").read_text())
    files = {name: update_file.make(NEW, fresh.roots[NEW], fresh.folder / name) for name in ("test.key", "new.key")}
    public = (keys / "test.pub").read_text()
    (keys / "test.pub").unlink()
    revoked = "signed with a key that this image does not trust"
    refused(fresh, fresh.run("write", stdin=files["test.key"]), before, revoked)
    (keys / "test.pub").write_text(public)
    for file in files.values():
        assert fresh.run("write", stdin=file).returncode == 0


@pytest.mark.parametrize("block, counted, reason", [
    ({"slot": "B", "left": "2"}, "left=2", "the boot loader could not start slot B"),
    ({"begun": "1", "failed": "B"}, "begun=1", "it was started three times, and each time it stopped or hung"),
    ({"begun": "1"}, "begun=1", None),  # the power was cut before the block was written
    ({"slot": "B", "begun": "3"}, "begun=3", None),  # kept; the power was cut before that was noted
])
def test_the_end_of_a_trial_is_noted_by_the_other_version(fresh: UpdateDisk, block: dict[str, str], counted: str,
                                                           reason: str | None) -> None:
    for command in ("write", "start"):
        assert fresh.run(command, stdin=fresh.update()).returncode == 0
    fresh.set_block(block)
    fresh.words(f"ddx.slot=A ddx.layout=1 ddx.counted={counted}")
    done = fresh.run("ended", "-reason", "; and more")
    assert done.returncode == (0 if reason else 1)
    status = json.loads(fresh.run("status", "-json").stdout)
    ended = ("returned", f"{reason}; and more") if reason else ("kept" if block.get("slot") else "none", "")
    assert (status["last"], status["reason"]) == ended
    assert fresh.run("ended").returncode == 1  # once
    fresh.run("block")
    assert (fresh.block() or {}).get("left") is None


def test_without_another_version_none_is_taken_back(tmp_path: pathlib.Path) -> None:
    """The machine would restart for ever."""
    if reason := lacking():
        pytest.skip(reason)
    with UpdateDisk(tmp_path, "B", former=False, block={"slot": "B", "left": "2"}) as disk:
        disk.words("ddx.slot=B ddx.layout=1 ddx.counted=left=2")
        done = disk.run("return", "-reason", "of no use")
        assert done.returncode == 1 and "slot A has no version to go back to" in done.stderr
        assert disk.block() == {"slot": "B", "left": "2"}


@pytest.mark.parametrize("broken, said", [
    (lambda file: file[:2_000_000], "the update file is cut short"),
    (lambda file: file + b"x" * 512, "not end after its member 'root'"),
    (lambda file: file[:1_500_000] + bytes([file[1_500_000] ^ 1]) + file[1_500_001:],
     "MiB 1 of the update file is not the one that was signed"),
], ids=["cut", "more", "changed"])
def test_a_stream_that_breaks_leaves_no_kernel(fresh: UpdateDisk, broken: Callable[[bytes], bytes], said: str) -> None:
    """Then the same update again: what is on the disk already is not written again."""
    done = fresh.run("write", stdin=broken(fresh.update()), pipe=True)
    assert done.returncode == 1 and said in done.stderr
    assert fresh.slot("B")[:1 << 20] == bytes(1 << 20) and fresh.slot("A").startswith(fresh.roots[RUNNING])
    assert fresh.run("start").returncode == 2
    assert fresh.block() == {}
    assert fresh.run("write", stdin=fresh.update(), pipe=True).returncode == 0
    assert fresh.slot("B").startswith(fresh.roots[NEW])


@pytest.mark.parametrize("blocks, status", [(1, 1), (2, 0), (21, 0), (22, 1)])
def test_the_end_of_an_archive(fresh: UpdateDisk, blocks: int, status: int) -> None:
    """Two blocks of zeros, and tar pads the file to a multiple of 20 blocks: 19 more at most."""
    root = fresh.roots[NEW]
    file = fresh.update()
    file = file[:file.index(root) + len(root)] + bytes(512 * blocks)
    assert fresh.run("write", stdin=file, pipe=True).returncode == status


DROPS = r"""
#include <dlfcn.h>
#include <sys/types.h>
/* A card that takes the write at 1.25 MiB, and forgets it. */
ssize_t pwrite64(int fd, const void *bytes, size_t size, off64_t offset) {
    ssize_t (*real)(int, const void *, size_t, off64_t) = dlsym(RTLD_NEXT, "pwrite64");
    return offset == 5 << 18 ? (ssize_t)size : real(fd, bytes, size, offset);
}
"""


def test_a_card_that_forgets_a_write_is_found(fresh: UpdateDisk) -> None:
    source, library = fresh.folder / "drops.c", fresh.folder / "drops.so"
    source.write_text(DROPS)
    run(["gcc", "-D_GNU_SOURCE", "-shared", "-fPIC", "-o", library, source])
    done = fresh.run("write", stdin=fresh.update(), env={"LD_PRELOAD": str(library)})
    assert done.returncode == 1 and "MiB 1 differs from what was written" in done.stderr
    assert fresh.slot("B")[:1 << 20] == bytes(1 << 20) and fresh.block() == {}


def test_settings_that_cannot_be_written_are_no_obstacle(fresh: UpdateDisk) -> None:
    run(["mount", "-o", "remount,ro", fresh.place / "data"])
    assert fresh.run("write", stdin=fresh.update()).returncode == 0
    done = fresh.run("start")
    assert done.returncode == 0 and "Read-only file system" in done.stderr
    assert fresh.block() == {"slot": "B", "left": "3"}
    fresh.words("ddx.slot=B ddx.layout=1 ddx.counted=left=3")
    assert json.loads(fresh.run("status", "-json").stdout)["last"] == "trial"


def test_keys(tmp_path: pathlib.Path) -> None:
    secret = tmp_path / "a/robots.key"
    public = update_file.make_key(secret, "-W")
    assert secret.stat().st_mode & 0o777 == 0o600 and public == tmp_path / "a/robots.key.pub"
    with pytest.raises(BadInput, match="exists already"):
        update_file.make_key(secret, "-W")
    with pytest.raises(BadInput, match="there is no key"):
        update_file.sign(b"", tmp_path / "none")


def test_the_words_for_an_image(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A secret key must not get into an image."""
    public = update_file.make_key(tmp_path / "robots.key", "-W")
    monkeypatch.setenv("UPDATE_KEYS", f"{public} {public}")
    with pytest.raises(BadInput, match="two keys have the same name"):
        trees.update_keys()
    for path in (tmp_path / "robots.key", tmp_path / "none"):
        monkeypatch.setenv("UPDATE_KEYS", str(path))
        with pytest.raises(BadInput, match="is no public key"):
            trees.update_keys()
    monkeypatch.setenv("UPDATE_KEYS", str(public))
    assert trees.update_keys() == [public]
    monkeypatch.setenv("SERIAL", "2000")
    monkeypatch.setenv("OLDEST", "2000")
    assert (trees.serial(), trees.oldest()) == ("2000", "2000")
    monkeypatch.setenv("OLDEST", "2001")
    with pytest.raises(BadInput, match="at most the image's own, 2000"):
        trees.oldest()
    monkeypatch.setenv("SERIAL", "on")
    with pytest.raises(BadInput, match="SERIAL=on: a number is needed"):
        trees.serial()


def test_minisign_and_tar_read_an_update_file(disk: UpdateDisk, tmp_path: pathlib.Path) -> None:
    (tmp_path / "file.update").write_bytes(disk.update())
    run(["tar", "-xf", "file.update"], cwd=tmp_path)
    run(["minisign", "-V", "-p", disk.folder / "test.key.pub", "-m", "manifest"], cwd=tmp_path)
    assert (tmp_path / "root").read_bytes() == disk.roots[NEW]
