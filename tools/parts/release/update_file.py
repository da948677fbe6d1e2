# SPDX-License-Identifier: GPL-2.0-or-later
"""Update files: an archive (ustar) of a manifest, its signature by minisign, and a root file system. docs/update.md
describes the format; package/ddxupdate reads it."""
import dataclasses
import hashlib
import io
import os
import pathlib
import subprocess
import tarfile

from parts.common import BadInput, Failed, run, scratch

PIECE = 1 << 20  # bytes with a hash of their own
SECTOR = 512
MEMBERS = ("manifest", "manifest.minisig", "root")  # in this order


@dataclasses.dataclass(frozen=True)
class Release:
    """The fields of an image's os-release."""
    board: str
    layout: str
    version: str
    serial: str


def release(root: pathlib.Path) -> Release:
    """That of a root file system (squashfs)."""
    text = run(["unsquashfs", "-cat", root, "usr/lib/os-release"])
    words = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)
    try:
        return Release(words["VARIANT_ID"], words["DDX_LAYOUT"], words["VERSION"].strip('"'), words["DDX_SERIAL"])
    except KeyError as error:
        raise Failed(f"{root}: its os-release has no {error.args[0]}; build the image again") from None


def manifest(what: Release, root: bytes) -> bytes:
    if len(root) % SECTOR or not root:
        raise Failed(f"a root file system of {len(root)} bytes is not made of whole sectors")
    lines = [f"board={what.board}", f"layout={what.layout}", f"version={what.version}", f"serial={what.serial}",
             f"size={len(root)}"]
    lines += [f"sha256={hashlib.sha256(root[at:at + PIECE]).hexdigest()}" for at in range(0, len(root), PIECE)]
    return "".join(f"{line}\n" for line in lines).encode()


def sign(message: bytes, key: pathlib.Path, *options: str) -> bytes:
    """The text of minisign's signature. For a key with a password, minisign asks for it at the terminal."""
    if not key.is_file():
        raise BadInput(f"there is no key {key}; `make update-key KEY={key}` makes one")
    with scratch() as folder:
        file, signature = folder / "manifest", folder / "manifest.minisig"
        file.write_bytes(message)
        done = subprocess.run(["minisign", "-S", *options, "-s", key, "-m", file, "-x", signature], check=False,
                              stdout=subprocess.DEVNULL)
        if done.returncode:
            raise Failed(f"{key}: minisign does not sign with it, see above")
        return signature.read_bytes()


def archive(members: list[tuple[str, bytes]]) -> bytes:
    """The same bytes each time."""
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for name, content in members:
            entry = tarfile.TarInfo(name)
            entry.size, entry.mode = len(content), 0o644
            tar.addfile(entry, io.BytesIO(content))
    return file.getvalue()


def make(what: Release, root: bytes, key: pathlib.Path) -> bytes:
    text = manifest(what, root)
    return archive(list(zip(MEMBERS, (text, sign(text, key), root))))


def read(file: pathlib.Path) -> Release:
    """The contents of an update file, by its manifest. Its signature is checked on the machine."""
    try:
        with tarfile.open(file, "r:") as tar:
            member = tar.extractfile(MEMBERS[0])
            lines = member.read().decode().splitlines() if member else []
        words = dict(line.split("=", 1) for line in lines)
        return Release(*(words[field.name] for field in dataclasses.fields(Release)))
    except FileNotFoundError:
        raise BadInput(f"there is no file {file}") from None
    except (tarfile.TarError, KeyError, ValueError, IsADirectoryError):
        raise BadInput(f"{file}: is no update file") from None


def make_key(secret: pathlib.Path, *options: str) -> pathlib.Path:
    """Make a pair of keys, the secret one for its owner alone; returns the public one. Without the option -W, minisign
    asks for a password."""
    public = secret.with_name(secret.name + ".pub")
    for path in (secret, public):
        if path.exists():
            raise BadInput(f"{path} exists already; choose another name")
    secret.parent.mkdir(parents=True, exist_ok=True)
    before = os.umask(0o077)
    try:
        done = subprocess.run(["minisign", "-G", *options, "-s", secret, "-p", public], check=False,
                              stdout=subprocess.DEVNULL)
    finally:
        os.umask(before)
    if done.returncode or not secret.exists():
        raise Failed("minisign made no keys, see above")
    secret.chmod(0o600)
    public.chmod(0o644)
    return public
