#!/bin/sh
# SPDX-License-Identifier: GPL-2.0-or-later
# Make disk.img from rootfs.squashfs: in the form of a Buildroot post-image script, for every board.
# Expects BINARIES_DIR; HOST_DIR (Buildroot's tools) when there is one.
set -eu

common=$(dirname "$0")
grub=${HOST_DIR:-/usr}/lib/grub
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
boot=$scratch/root/boot

# TARGET IMAGE MODULE...: GRUB's core, which finds its menu on the first partition of its own disk
core() {
	format=$1 image=$2
	shift 2
	# shellcheck disable=SC2046 # a list of words
	grub-mkimage --format="$format" --directory="$grub/$format" --prefix='(,msdos1)/grub' --output="$image" "$@" \
		$(sed 's/#.*//' "$common/grub-modules.txt")
}

# Legacy BIOS: MBR and the gap after it. UEFI, if the board has it: a file that firmware looks for on any disk.
cp "$grub/i386-pc/boot.img" "$BINARIES_DIR/"
core i386-pc "$BINARIES_DIR/core.img" biosdisk
mkdir -p "$boot/grub"
if [ -d "$grub/x86_64-efi" ]; then
	mkdir -p "$boot/EFI/BOOT"
	core x86_64-efi "$boot/EFI/BOOT/BOOTX64.EFI" all_video
fi
cp "$common/ddx.txt" "$common/screen-off.txt" "$common/serial-off.txt" "$boot/"
cp "$common/grub.cfg" "$boot/grub/"
# An empty environment block: 1024 bytes, to be overwritten in place.
grub-editenv "$boot/grub/grubenv" create

# The same image from the same sources: no times of this build (BR2_REPRODUCIBLE sets the variable).
if [ -n "${SOURCE_DATE_EPOCH:-}" ]; then
	find "$scratch/root" -exec touch -h -d "@$SOURCE_DATE_EPOCH" {} +
	export E2FSPROGS_FAKE_TIME="$SOURCE_DATE_EPOCH" E2FSCK_TIME="$SOURCE_DATE_EPOCH" # genimage runs mke2fs and e2fsck
fi

# mke2fs and mkfs.vfat are in sbin, which is not on every user's path
PATH=$PATH:/usr/sbin:/sbin genimage --loglevel=1 --config "$common/disk.cfg" --rootpath "$scratch/root" \
	--tmppath "$scratch/tmp" --inputpath "$BINARIES_DIR" --outputpath "$BINARIES_DIR"
