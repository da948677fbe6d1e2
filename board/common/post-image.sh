#!/bin/sh
# SPDX-License-Identifier: GPL-2.0-or-later
# Make disk.img from rootfs.squashfs: in the shape of a Buildroot post-image script, for every board.
# Expects BINARIES_DIR; HOST_DIR (Buildroot's tools) when there is one.
set -eu

common=$(dirname "$0")
grub=${HOST_DIR:+$HOST_DIR/lib/grub/i386-pc}
[ -n "$grub" ] && [ -d "$grub" ] || grub=/usr/lib/grub/i386-pc

cp "$common/grub.cfg" "$common/ddx.txt" "$grub/boot.img" "$BINARIES_DIR/"
modules=$(sed 's/#.*//' "$common/grub-modules.txt" | tr '\n' ' ')
# shellcheck disable=SC2086 # a list of words
grub-mkimage --format=i386-pc --directory="$grub" --prefix='(,msdos1)/grub' --output="$BINARIES_DIR/core.img" $modules

# An empty environment block: 1024 bytes, to be overwritten in place.
rm -f "$BINARIES_DIR/grubenv"
grub-editenv "$BINARIES_DIR/grubenv" create

# genimage wants a root and a scratch folder, both empty.
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
mkdir "$scratch/root"
# mke2fs and mkfs.vfat are in sbin, which is not on everybody's path
PATH=$PATH:/usr/sbin:/sbin genimage --loglevel=1 --config "$common/disk.cfg" --rootpath "$scratch/root" \
	--tmppath "$scratch/tmp" --inputpath "$BINARIES_DIR" --outputpath "$BINARIES_DIR"
