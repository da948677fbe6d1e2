#!/bin/sh
# SPDX-License-Identifier: GPL-2.0-or-later
# Folders and links that neither a package nor git can bring; in the shape of a Buildroot post-build script.
# Runs again on a kept target folder, so every line may be repeated.
set -eu

target=$1

# Mount points. The root is read-only: without their file system nothing can be written below them.
for folder in boot data dev mnt proc rec run sys test tmp var; do
	mkdir -p "$target/$folder"
done
for name in run tmp; do
	rm -rf "${target:?}/var/$name"
	ln -s "../$name" "$target/var/$name"
done
