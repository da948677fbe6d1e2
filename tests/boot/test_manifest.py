# SPDX-License-Identifier: GPL-2.0-or-later
"""The image has what board/common/manifest.txt says."""
import pathlib

import manifest


def test_applets(root: pathlib.Path) -> None:
    assert manifest.applets(root) == []


def test_programs(root: pathlib.Path) -> None:
    assert manifest.programs(root) == []


def test_kernel_options(image: pathlib.Path) -> None:
    assert manifest.kernel(image.parent / "kernel/boot/config") == []


def test_modules(root: pathlib.Path) -> None:
    assert manifest.modules(root) == []


def test_users_and_groups(root: pathlib.Path) -> None:
    assert manifest.accounts(root) == []


def test_services_and_their_order(root: pathlib.Path) -> None:
    wanted, found = manifest.services(root)
    assert found == wanted


def test_disk_layout(image: pathlib.Path) -> None:
    assert manifest.disk(image) == []
