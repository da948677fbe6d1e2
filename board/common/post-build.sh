#!/bin/sh
# SPDX-License-Identifier: GPL-2.0-or-later
# Folders, links and the version, which neither a package nor git provides; in the form of a Buildroot post-build
# script. Every line may be repeated, since the target folder is used again.
set -eu

target=$1
common=$(dirname "$0")

# Mount points. The root is read-only: without their file system nothing can be written below them.
for folder in boot data dev mnt proc rec run sys test tmp var; do
	mkdir -p "$target/$folder"
done
for name in run tmp; do
	rm -rf "${target:?}/var/$name"
	ln -s "../$name" "$target/var/$name"
done

# The version, instead of Buildroot's own file. The tools set commit and board.
number=$(sed -n "s/^  version: '\(.*\)',\$/\1/p" "$common/../../package/ddx/meson.build")
commit=${DDX_COMMIT:-$(git -C "$common" describe --always --dirty --abbrev=12 2> /dev/null || echo unknown)}
board=${DDX_BOARD:-unknown}
base=${BR2_VERSION:+Buildroot $BR2_VERSION}
version="$number ($commit, $board, ${base:=Debian})"
mkdir -p "$target/usr/lib" "$target/etc"
serial=${DDX_SERIAL:-$(git -C "$common" log -1 --format=%ct 2> /dev/null || echo 0)}
cat > "$target/usr/lib/os-release" << LINES
NAME=DDXVIDEO
ID=ddxvideo
PRETTY_NAME="DDXVIDEO $version"
VERSION="$version"
VERSION_ID=$number
BUILD_ID=$commit
VARIANT_ID=$board
DDX_BASE="$base"
DDX_LAYOUT=1
DDX_SERIAL=$serial
DDX_OLDEST=${DDX_OLDEST:-0}
LINES
ln -sf ../usr/lib/os-release "$target/etc/os-release"

# The public keys of updates that this image accepts; those of an earlier build of this folder are revoked.
rm -rf "$target/etc/ddx/update-keys"
mkdir -p "$target/etc/ddx/update-keys"
for key in ${UPDATE_KEYS:-}; do
	install -m 644 "$key" "$target/etc/ddx/update-keys/"
done

# Programs and libraries that packages bring and no program of the image needs; a program of another tree may need a
# library.
for program in e4crypt logsave mklost+found xxh32sum xxh64sum xxh128sum xxh3sum xxhsum; do
	rm -f "$target/sbin/$program" "$target/usr/sbin/$program" "$target/usr/bin/$program"
done
for library in libcrypt libmvec libss libnl-idiag-3 libnl-nf-3 libnl-xfrm-3 libnl-route-3; do
	grep -qrF --exclude="$library.so*" "$library.so" "$target" ||
		rm -f "$target/lib/$library".so* "$target/usr/lib/$library".so*
done
# BusyBox reads none of these.
rm -f "$target"/lib/modules/*/modules.*.bin "$target"/lib/modules/*/modules.order \
	"$target"/lib/modules/*/modules.builtin.modinfo

# Folders of services for S19ready; overlays and the packages of all trees are in place by now. A package's own script
# may do more than `service` does, so it does it at the boot.
ready=$target/usr/share/ddx/ready
rm -rf "$ready"
mkdir -p "$ready"
: > "$ready/idle"
for script in "$target"/etc/init.d/S??*; do
	name=${script##*/S??}
	if [ -f "$target/etc/default/$name" ] && grep -q '^[[:space:]]*\. /usr/libexec/ddx/service$' "$script"; then
		sh "$target/usr/libexec/ddx/service" "$name" prepare "$target"
	fi
done

# Actions of mksquashfs for the files that each boot reads: see boot-files.txt.
sed -n 's|^/\([^ ]*\).*|pathname(\1)|p; t; s|^\([a-z][^/ ]*\).*|name(\1)|p' "$common/boot-files.txt" |
	while read -r which; do
		printf 'uncompressed@%s\nno-fragments@%s\n' "$which" "$which"
	done > "$target/../boot-files.actions"
